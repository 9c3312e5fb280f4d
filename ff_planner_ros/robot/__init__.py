"""The robot: model from URDF, momentum, generalised Jacobian, velocity map."""
