"""Refuses a plan that breaks a requirement; knows neither solver nor search."""
