"""Messages to planning objects and back."""
