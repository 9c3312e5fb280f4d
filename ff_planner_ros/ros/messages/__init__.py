"""Messages to planning objects and back: pure functions, no clock."""
