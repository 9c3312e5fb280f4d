"""The check of a plan; it knows neither solver nor search."""
