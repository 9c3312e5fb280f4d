"""Plans as JSON, tables and figures."""
