"""Limits of joint positions, velocities, accelerations and torques."""
