"""What the node hears: the newest state and the newest scene."""
