"""Pages and tables of recorded runs, plans and campaigns."""
