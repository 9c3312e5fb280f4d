"""One atomic snapshot of the chaser and its arm."""

from __future__ import annotations

from dataclasses import dataclass

from ff_planner_ros.common.arrays import Array, finite_vector
from ff_planner_ros.common.declared import check_declared, declare
from ff_planner_ros.common.forms import QUATERNION, TRUTH, a_vector
from ff_planner_ros.common.shown import in_a_line

# Scenario key of the wheels' momenta.
STORED = "robot.wheels.stored"


@dataclass(frozen=True, eq=False)
class SystemState:
    """State of a free-floating system: chaser pose and twist, the motion of the joints.

    The chaser frame has its origin at the centre of mass of the chaser alone and the axes
    of the base link. Twists are about that centre of mass, in axes of the inertial frame.

    Raises:
        InvalidInput: A value has the wrong size, is not finite, or the quaternion is not
            of unit norm.
    """

    position_chaser_in_inertial: Array = declare(
        a_vector(),
        "of the chaser's centre of mass",
        key="chaser.position",
        unit="m",
        message="pose.position",
    )
    quaternion_chaser_to_inertial_xyzw: Array = declare(
        QUATERNION,
        "chaser axes to inertial axes",
        key="chaser.quaternion_xyzw",
        message="pose.orientation",
    )
    linear_velocity_chaser_in_inertial: Array = declare(
        a_vector(),
        "of the chaser's centre of mass",
        key="chaser.linear_velocity",
        unit="m/s",
        message="twist.linear",
    )
    angular_velocity_chaser_in_inertial: Array = declare(
        a_vector(),
        "of the chaser, in inertial axes",
        key="chaser.angular_velocity",
        unit="rad/s",
        message="twist.angular",
    )
    # All three have the shape (joints,)
    joint_positions: Array = declare(
        a_vector(None),
        "one number a joint",
        key="joints.position",
        unit="rad, m",
        message="joint_positions",
    )
    joint_velocities: Array = declare(
        a_vector(None),
        "one number a joint",
        key="joints.velocity",
        unit="rad/s, m/s",
        instead=(
            "end_effector_at_rest",
            TRUTH,
            "the joint velocities that hold the end effector at rest",
        ),
        message="joint_velocities",
    )
    # None: a plan begins with constant null-space motion
    joint_accelerations: Array | None = declare(
        a_vector(None),
        "one number a joint; default: not known, the end effector begins at zero acceleration",
        key="joints.acceleration",
        unit="rad/s2, m/s2",
        default=None,
        message="joint_accelerations",
    )
    # Of each wheel that holds the chaser's attitude [N m s]; None: zero, or there are none
    wheel_momenta: Array | None = None
    # Whether a file asked for the joint velocities that hold the end effector at rest
    ee_at_rest: bool = False

    FACTS = ("position_chaser_in_inertial", "quaternion_chaser_to_inertial_xyzw", "joint_positions")
    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Check every value and replace it by a read-only copy."""
        check_declared(self, "", ee_at_rest=bool)
        joints = len(self.joint_positions)
        finite_vector("joints.velocity", self.joint_velocities, joints)
        if self.joint_accelerations is not None:
            finite_vector("joints.acceleration", self.joint_accelerations, joints)
        if self.wheel_momenta is not None:
            momenta = a_vector(None).checked(STORED, self.wheel_momenta)
            object.__setattr__(self, "wheel_momenta", momenta)
