"""What the joints keep: positions, velocities, accelerations and torques within their limits."""
