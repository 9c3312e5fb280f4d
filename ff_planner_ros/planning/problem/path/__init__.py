"""A path to follow: its points and the curve through them."""
