"""For every package: arrays, texts, YAML files, and fields that are declared once."""
