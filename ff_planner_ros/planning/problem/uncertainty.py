"""Model and start errors: standard deviations, first-order directions and random draws.

A drawn body has the modelled mass and inertia about the centre of mass, each times its own factor
exp(sigma e) with e normal, and a displaced centre of mass. So its mass is positive and its
principal moments satisfy the triangle inequality, however wide the draw.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.declared import check_declared, declare
from ff_planner_ros.common.declared_parts import changes
from ff_planner_ros.common.forms import a_number
from ff_planner_ros.robot.model import Base, Robot
from ff_planner_ros.robot.momentum import PARAMETERS

# A mass known to a factor of e only, or a velocity to 1 m/s, is not known at all.
_DEVIATION = a_number(at_least=0.0, at_most=1.0)  # [share, m, m/s or rad/s]


@dataclass(frozen=True)
class Uncertainty:
    """Standard deviations of independent normal errors.

    Raises:
        InvalidInput: Not finite, negative, or above 1.
    """

    mass: float = declare(_DEVIATION, "of each body's mass", unit="share", default=0.01)
    inertia: float = declare(
        _DEVIATION, "of each body's inertia about its centre of mass", unit="share", default=0.01
    )
    center_of_mass: float = declare(
        _DEVIATION, "of each body, along each axis", unit="m", default=0.0
    )
    linear_velocity: float = declare(
        _DEVIATION, "of the chaser at the start, along each axis", unit="m/s", default=0.0
    )
    angular_velocity: float = declare(
        _DEVIATION, "of the chaser at the start, about each axis", unit="rad/s", default=1.75e-4
    )
    # These two have no effect on controlled joints: they count in open-loop torque control
    joint_velocity: float = declare(
        _DEVIATION, "of each joint at the start", unit="rad/s", default=0.0
    )
    friction: float = declare(
        _DEVIATION,
        "viscous friction of each joint, as a share of its peak torque at the highest rate",
        unit="share",
        default=0.0,
    )

    def __post_init__(self) -> None:
        """Check every value."""
        check_declared(self, "uncertainty")


def uncertainty_from(field: str, value: object) -> Uncertainty:
    """Return deviations from a mapping of names to numbers; those left out are the defaults.

    Raises:
        InvalidInput: It is no such mapping, or a value is out of range.
    """
    return Uncertainty(**changes(Uncertainty).read(field, value))


class Directions(NamedTuple):
    """Change of a system per standard deviation of each independent error, to first order."""

    parameters: Array  # inertial parameters of all bodies; shape (10 * bodies, errors)
    base_twist: Array  # at the start, in the base frame; shape (6, errors)


class Draws(NamedTuple):
    """Random systems, one for each run."""

    errors: Array  # normal, of deviation 1, in the order of `directions`; shape (runs, errors)
    parameters: Array  # inertial parameters of all bodies; shape (runs, 10 * bodies)
    base_twist: Array  # error at the start, in the base frame; shape (runs, 6)
    # For open-loop torque control: factors of masses and of inertias about the centres of mass,
    # shape (runs, bodies); errors of the joint velocities at the start [rad/s] and viscous friction
    # as a share of each joint's peak torque, shape (runs, joints)
    masses: Array
    inertias: Array
    joint_rates: Array
    friction: Array


def directions(robot: Robot, uncertainty: Uncertainty) -> Directions:
    """Return the directions of the errors: mass, inertia, centre of each body; then the twist."""
    bodies = list(robot.model.inertias)[1:]
    count = 5 * len(bodies)
    parameters = np.zeros((PARAMETERS * len(bodies), count + 6))
    for index, body in enumerate(bodies):
        rows, first = slice(PARAMETERS * index, PARAMETERS * (index + 1)), 5 * index
        mass, center, inertia = body.mass, np.array(body.lever), np.array(body.inertia)
        nothing = np.zeros((3, 3))
        parameters[rows, first] = uncertainty.mass * _parameters(mass, center, nothing)
        parameters[rows, first + 1] = uncertainty.inertia * _parameters(0.0, np.zeros(3), inertia)
        for axis in range(3):
            moved = np.eye(3)[axis]
            turned = 2.0 * center[axis] * np.eye(3) - np.outer(moved, center)
            turned -= np.outer(center, moved)
            change = np.concatenate([[0.0], mass * moved, _six(mass * turned)])
            parameters[rows, first + 2 + axis] = uncertainty.center_of_mass * change
    twist = np.zeros((6, count + 6))
    twist[:, count:] = _start_errors(robot, uncertainty)
    return Directions(parameters, twist)


def draws(robot: Robot, uncertainty: Uncertainty, runs: range, seed: int) -> Draws:
    """Draw systems; the draw of a run depends on the seed and its own number alone."""
    bodies, joints = list(robot.model.inertias)[1:], robot.joints
    count = 5 * len(bodies) + 6
    numbers = [np.random.default_rng([seed, k]).normal(size=count + 2 * joints) for k in runs]
    errors, of_joints = np.split(np.array(numbers), [count], axis=1)
    of_bodies = errors[:, :-6].reshape(len(errors), len(bodies), 5)
    masses = np.exp(uncertainty.mass * of_bodies[:, :, 0])
    inertias = np.exp(uncertainty.inertia * of_bodies[:, :, 1])
    parameters = np.empty((len(errors), PARAMETERS * len(bodies)))
    for index, body in enumerate(bodies):
        mass, center, inertia = body.mass, np.array(body.lever), np.array(body.inertia)
        columns = slice(PARAMETERS * index, PARAMETERS * (index + 1))
        for k in range(len(errors)):
            parameters[k, columns] = _parameters(
                mass * masses[k, index],
                center + uncertainty.center_of_mass * of_bodies[k, index, 2:],
                inertia * inertias[k, index],
            )
    rates, friction = np.split(of_joints, 2, axis=1)
    return Draws(
        errors=errors,
        parameters=parameters,
        base_twist=errors[:, -6:] @ _start_errors(robot, uncertainty).T,
        masses=masses,
        inertias=inertias,
        joint_rates=uncertainty.joint_velocity * rates,
        friction=uncertainty.friction * np.abs(friction),
    )


def _start_errors(robot: Robot, uncertainty: Uncertainty) -> Array:
    """Return the base's twist by errors of the chaser's velocities, base axes. Shape (6, 6).

    The chaser's velocity is that of its centre of mass, the base's that of its own origin.
    """
    by_errors = np.zeros((6, 6))
    by_errors[:3, :3] = uncertainty.linear_velocity * np.eye(3)
    by_errors[:3, 3:] = uncertainty.angular_velocity * pin.skew(robot.position_chaser_in_base)
    by_errors[3:, 3:] = uncertainty.angular_velocity * np.eye(3)
    if robot.base is not Base.FREE_FLYER:
        borne = np.setdiff1d(range(6), robot.base.rows)
        by_errors[borne] = 0.0
        by_errors[:, borne] = 0.0
    return by_errors


def _parameters(mass: float, center: Array, inertia: Array) -> Array:
    """Return the parameters of a body from its inertia about its centre of mass. Shape (10,)."""
    about_origin = inertia + mass * (center @ center * np.eye(3) - np.outer(center, center))
    return np.concatenate([[mass], mass * center, _six(about_origin)])


def _six(inertia: Array) -> Array:
    """Return xx, xy, yy, xz, yz, zz."""
    return np.asarray(inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]], np.float64)
