"""Pages and tables on recorded runs, plans and campaigns."""
