"""The page of a campaign: its map as a picture to click in, and the case of a click."""
