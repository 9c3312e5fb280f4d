"""Thousands of plans: a study becomes cases, a Dask cluster plans them, Parquet keeps them."""
