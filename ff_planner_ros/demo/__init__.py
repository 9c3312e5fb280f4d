"""The demonstration: a simulated testbed and a mission executive, users of the node."""
