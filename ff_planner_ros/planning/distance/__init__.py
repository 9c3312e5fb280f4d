"""How near bodies come to each other, and for certain between the points of a motion, too."""
