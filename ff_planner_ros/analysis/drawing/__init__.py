"""Figures and scenes of plans."""
