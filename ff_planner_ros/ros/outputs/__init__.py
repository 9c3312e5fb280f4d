"""The publications of the node: plans, predictions, markers and diagnostics."""
