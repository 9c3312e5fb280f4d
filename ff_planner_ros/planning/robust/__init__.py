"""Margins for uncertainty."""
