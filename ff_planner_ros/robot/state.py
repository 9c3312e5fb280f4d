"""One atomic snapshot of the chaser and its arm."""

from __future__ import annotations

from dataclasses import dataclass

from ff_planner_ros.arrays import Array, finite_vector, unit_quaternion


@dataclass(frozen=True, eq=False)
class SystemState:
    """State of a free-floating system: chaser pose and twist, the motion of the joints.

    The chaser frame has its origin at the centre of mass of the chaser alone and the axes
    of the base link. Twists are about that centre of mass, in axes of the inertial frame.

    Raises:
        InvalidInput: A value has the wrong size, is not finite, or the quaternion is not
            of unit length.
    """

    position_chaser_in_inertial: Array  # shape (3,) [m]
    quaternion_chaser_to_inertial_xyzw: Array  # shape (4,), unit length
    linear_velocity_chaser_in_inertial: Array  # shape (3,) [m/s]
    angular_velocity_chaser_in_inertial: Array  # shape (3,) [rad/s]
    joint_positions: Array  # shape (joints,) [rad]
    joint_velocities: Array  # shape (joints,) [rad/s]
    # Shape (joints,) [rad/s2]; None: not known, a plan begins with the end effector at zero
    # acceleration and with null-space motion that does not change
    joint_accelerations: Array | None = None

    def __post_init__(self) -> None:
        """Check every value and replace it by a read-only copy."""
        joints = len(self.joint_positions)
        for name, field, size in (
            ("position_chaser_in_inertial", "chaser.position", 3),
            ("quaternion_chaser_to_inertial_xyzw", "chaser.quaternion_xyzw", 4),
            ("linear_velocity_chaser_in_inertial", "chaser.linear_velocity", 3),
            ("angular_velocity_chaser_in_inertial", "chaser.angular_velocity", 3),
            ("joint_positions", "joints.position", joints),
            ("joint_velocities", "joints.velocity", joints),
            ("joint_accelerations", "joints.acceleration", joints),
        ):
            if getattr(self, name) is None and name == "joint_accelerations":
                continue
            values = finite_vector(field, getattr(self, name), size)
            if field == "chaser.quaternion_xyzw":
                values = unit_quaternion(field, values)
            object.__setattr__(self, name, values)
