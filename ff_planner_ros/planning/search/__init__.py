"""The search for a path, from initial guesses to the best path that passes the check."""
