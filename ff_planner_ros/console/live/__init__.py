"""The console of a running node: its inputs and plans, and requests and releases to it."""
