"""A free-flying robot: kinematics, momentum, dynamics."""
