"""One atomic snapshot of the chaser and its arm."""

from __future__ import annotations

from dataclasses import dataclass

from ff_planner_ros.arrays import Array, finite_vector, unit_quaternion


@dataclass(frozen=True, eq=False)
class SystemState:
    """State of a free-floating system: chaser pose and twist, joint positions and rates.

    The chaser frame has its origin at the centre of mass of the chaser alone and the axes
    of the base link. Twists are about that centre of mass, in axes of the inertial frame.

    Attributes:
        position_chaser_in_inertial: Shape (3,) [m].
        quaternion_chaser_to_inertial_xyzw: Shape (4,), unit length.
        linear_velocity_chaser_in_inertial: Shape (3,) [m/s].
        angular_velocity_chaser_in_inertial: Shape (3,) [rad/s].
        joint_positions: Shape (joints,) [rad].
        joint_velocities: Shape (joints,) [rad/s].

    Raises:
        InvalidInput: A value has the wrong size, is not finite, or the quaternion is not
            of unit length.
    """

    position_chaser_in_inertial: Array
    quaternion_chaser_to_inertial_xyzw: Array
    linear_velocity_chaser_in_inertial: Array
    angular_velocity_chaser_in_inertial: Array
    joint_positions: Array
    joint_velocities: Array

    def __post_init__(self) -> None:
        """Check every value and replace it by a read-only copy."""
        joints = len(self.joint_positions)
        checked = {
            "position_chaser_in_inertial": finite_vector(
                "chaser.position", self.position_chaser_in_inertial, 3
            ),
            "quaternion_chaser_to_inertial_xyzw": unit_quaternion(
                "chaser.quaternion_xyzw", self.quaternion_chaser_to_inertial_xyzw
            ),
            "linear_velocity_chaser_in_inertial": finite_vector(
                "chaser.linear_velocity", self.linear_velocity_chaser_in_inertial, 3
            ),
            "angular_velocity_chaser_in_inertial": finite_vector(
                "chaser.angular_velocity", self.angular_velocity_chaser_in_inertial, 3
            ),
            "joint_positions": finite_vector("joints.position", self.joint_positions, joints),
            "joint_velocities": finite_vector("joints.velocity", self.joint_velocities, joints),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)
