"""What the node publishes: plans, predictions, markers, diagnostics."""
