"""What every room may use: arrays, texts, files of YAML, and fields that are declared once."""
