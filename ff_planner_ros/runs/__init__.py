"""Tasks recorded in bags: replayed, or planned again with changes."""
