"""MCAP files, also damaged ones, and messages decoded by the definitions in them."""
