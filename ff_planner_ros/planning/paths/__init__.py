"""Path families, and the initial guesses of each."""
