"""First guesses for the solver: the straight path, detours around what blocks it, and others."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

import numpy as np
from scipy.stats import qmc

from ff_planner_ros.arrays import Array
from ff_planner_ros.errors import NoPlanFound
from ff_planner_ros.planning.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.polynomial import COMPONENTS, FREE_TERMS, PARAMETERS
from ff_planner_ros.planning.program import PathProgram

# How far beyond the surface of a sphere a detour passes [m]: the arm's links follow the end
# effector only in part.
_BESIDE = 0.1
# The free term's bump is flat at its ends: an obstacle there is not avoided by a huge bump in the
# middle. 1 at the middle of the path.
_LEAST_BUMP = 0.3
# Spread of the other guesses: wide enough to come to the other side of an obstacle, not so wide
# that most leave the workspace [m, rad].
_SPREAD_POSITION, _SPREAD_ANGLE = 0.3, 0.4


def first_guesses(program: PathProgram, count: int) -> Iterator[Array]:
    """Yield coefficients to start from, always the same for the same problem.

    Yields:
        Flattened coefficients. Shape (18,).
    """
    yield from islice(_guesses(program), count)


def _guesses(program: PathProgram) -> Iterator[Array]:
    """Yield without end; each kind is worked out only when the one before has not helped."""
    yield np.zeros(PARAMETERS)
    yield from _detours(program)
    spread = np.repeat([_SPREAD_POSITION] * 3 + [_SPREAD_ANGLE] * 3, FREE_TERMS)
    sequence = qmc.MultivariateNormalQMC(
        np.zeros(PARAMETERS), engine=qmc.Halton(PARAMETERS, rng=np.random.default_rng(0))
    )
    while True:
        yield sequence.random(1)[0] * spread


def _detours(program: PathProgram) -> list[Array]:
    """Pass the sphere that the straight path runs deepest into on its four sides."""
    try:
        rollout = program.rollouts.roll_out(np.zeros((COMPONENTS, FREE_TERMS)))
    except NoPlanFound:
        return []
    positions = arm_points(program.robot, rollout.q)
    clear = clearances(positions, segments(positions), program.spheres)
    if clear.distance.min(initial=np.inf) >= 0.0:
        return []
    deepest = np.unravel_index(clear.distance.argmin(), clear.distance.shape)
    out = clear.direction[deepest]
    radius, depth = program.spheres[int(deepest[2])].radius, -clear.distance[deepest]
    aside = np.cross(out, positions[-1, -1] - positions[0, -1])
    aside /= max(float(np.linalg.norm(aside)), 1e-9)
    s = rollout.s[deepest[0]]
    bump = max(64.0 * s**3 * (1.0 - s) ** 3, _LEAST_BUMP)
    ways = (
        out * (depth + _BESIDE),
        aside * (radius + _BESIDE),
        -aside * (radius + _BESIDE),
        -out * (2.0 * radius - depth + _BESIDE),
    )
    detours = []
    for way in ways:
        coefficients = np.zeros((COMPONENTS, FREE_TERMS))
        coefficients[:3, 0] = way / bump
        detours.append(coefficients.ravel())
    return detours
