"""Margins for what is uncertain."""
