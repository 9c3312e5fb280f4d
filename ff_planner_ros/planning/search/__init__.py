"""The search for a path, from first guesses to the best that passes the check."""
