"""The recorder of everything that the node hears and says."""
