"""The forces of the artificial potential field, Sec. 4.1 of the paper, on a body of unit mass.

The paper names attraction of constant magnitude and the Born approximation of the Yukawa
potential for the repulsion; the rest, and every value, is our reading. The attraction fades
linearly close to the goal, where a constant force could never come to rest. The repulsion's
distance is that of a link's nearest point from a sphere's surface, and acts on the end effector
by virtual work: the end effector's path goes down the potential of the whole arm.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.declared import check_declared, declare
from ff_planner_ros.common.forms import a_number
from ff_planner_ros.common.plain_values import mapping
from ff_planner_ros.common.yaml_file import read_yaml
from ff_planner_ros.planning.distance.clearance import (
    arm_points_with_derivatives,
    clearance_gradients,
    clearances,
    segments,
)
from ff_planner_ros.planning.problem.problem import PlanningProblem

_BLOCK = "artificial_potential_field"


@dataclass(frozen=True)
class PotentialFieldParameters:
    """Parameters of the field and its integration; `config/baselines.yaml` has the values.

    Raises:
        InvalidInput: A value is of the wrong type or out of its range.
    """

    attraction: float = declare(
        a_number(at_least=1e-6),
        "Magnitude of the attraction towards the goal position",
        unit="m/s2",
    )
    angular_attraction: float = declare(
        a_number(at_least=1e-6),
        "Magnitude of the attraction towards the goal orientation",
        unit="rad/s2",
    )
    damping: float = declare(
        a_number(at_least=1e-3),
        "Deceleration per velocity; attraction / damping is the cruising speed",
        unit="1/s",
    )
    repulsion: float = declare(
        a_number(at_least=0.0),
        "Strength of the Yukawa potential between a link and a sphere",
        unit="m3/s2",
    )
    decay: float = declare(
        a_number(at_least=0.0), "Decay of the Yukawa potential with the distance", unit="1/m"
    )
    smallest_distance: float = declare(
        a_number(at_least=1e-4),
        "Nearer to a surface, and inside a sphere, the repulsion grows no more",
        unit="m",
    )
    longest_step: float = declare(
        a_number(at_least=1e-4), "Longest step of the integration", unit="s"
    )

    def __post_init__(self) -> None:
        """Check every value against its declaration."""
        check_declared(self, _BLOCK)


def load_parameters(path: Path) -> PotentialFieldParameters:
    """Read the block `artificial_potential_field` of a file such as `config/baselines.yaml`.

    Raises:
        InvalidInput: The file cannot be read, or a parameter is missing, unknown or out of range.
    """
    block = mapping("", read_yaml(path), required=(_BLOCK,))[_BLOCK]
    names = [item.name for item in fields(PotentialFieldParameters)]
    return PotentialFieldParameters(**mapping(_BLOCK, block, required=names))


def attraction(offset: Array, parameters: PotentialFieldParameters) -> Array:
    """Return the acceleration towards a goal at an offset [m], rotation vector [rad]; shape (6,).

    Its magnitude is constant except close to the goal. There it is that of a critically damped
    spring: the end effector comes to rest without overshoot.
    """
    stiffness = parameters.damping**2 / 4
    magnitudes = (parameters.attraction, parameters.angular_attraction)
    parts = [
        part * min(stiffness, magnitude / max(float(np.linalg.norm(part)), np.finfo(float).tiny))
        for part, magnitude in zip((offset[:3], offset[3:]), magnitudes, strict=True)
    ]
    return np.concatenate(parts)


def repulsion(
    problem: PlanningProblem,
    parameters: PotentialFieldParameters,
    time: float,
    q: Array,
    v_by_twist: Array,
) -> tuple[Array, Array]:
    """Return the acceleration of the end effector away from the obstacles, and the distances.

    The potential of a link at distance d is U = g exp(-decay d) / d. Its force on the end effector
    follows from virtual work in the motion of Eq. (31) at zero momentum.

    Args:
        time: From the plan's first point [s].
        q: Configuration. Shape (7 + joints,).
        v_by_twist: Derivative of the tangent velocity with respect to the end effector's twist,
            inertial axes. Shape (6 + joints, 6).

    Returns:
        Linear, angular, shape (6,); and the clearances, shape (links, spheres) [m].
    """
    positions, derivatives = arm_points_with_derivatives(problem.robot, q[None], v_by_twist[None])
    starts = segments(positions)
    spheres = [one for one in problem.obstacles if one.is_sphere]
    clear = clearances(positions, np.array([time]), starts, spheres)
    distance = np.maximum(clear.distance, parameters.smallest_distance)
    growth = 1.0 + parameters.decay * distance
    force = parameters.repulsion * np.exp(-parameters.decay * distance) * growth / distance**2
    every = tuple(index.ravel() for index in np.indices(force.shape))
    total: Array = force.ravel() @ clearance_gradients(clear, derivatives, starts, every)
    return total, clear.distance[0]
