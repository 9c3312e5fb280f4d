"""The programs that a search solves, and their solver."""
