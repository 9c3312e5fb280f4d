"""What the node subscribes to: state and scene."""
