"""Limits as data: of joints, loads, wheels and the chaser; a new one is a class and an entry."""
