"""The console on a running node: what it hears, asks for, releases, and shows of it."""
