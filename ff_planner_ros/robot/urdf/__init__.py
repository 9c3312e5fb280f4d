"""URDF, SDF, SRDF and meshes, read with the care that files from outside need."""
