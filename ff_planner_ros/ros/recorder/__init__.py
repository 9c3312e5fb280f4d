"""The recorder, which writes the topics and requests of a running node to a bag."""
