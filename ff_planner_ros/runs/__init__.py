"""Requests rebuilt from bags: replayed, or planned again with changes."""
