"""MCAP files, byte by byte, and messages decoded by the definitions in them."""
