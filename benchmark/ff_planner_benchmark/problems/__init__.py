"""Problems that no campaign draws, each but a random start with a motion that solves it."""
