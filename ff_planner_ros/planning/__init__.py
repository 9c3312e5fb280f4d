"""From a problem to a checked plan."""
