"""Depths of solids whose axes are nearly parallel, against those of parallel ones.

A turn moves no point of a solid by more than its angle times the solid's reach, and changes the
depth by no more: what is known in closed form of parallel axes holds for nearly parallel ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pinocchio as pin
import pytest
from bodied_robots import random_robot
from core_rows import distances_of_core
from scipy.spatial.transform import Rotation
from test_body_distances import configurations
from test_obstacle_shapes import FAR

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.problem.obstacles import Obstacle, RigidMotion
from ff_planner_ros.robot.collision.bodies import Body
from ff_planner_ros.robot.collision.solids import Solid, hull_of_vertices

EXACT = 1e-6  # [m]
OF_EACH = 20  # others beside a solid
KINDS = ("sphere", "capsule", "cylinder", "box", "mesh")
_CORNERS = np.array([*product((-1.0, 1.0), repeat=3)])


@dataclass(frozen=True)
class Along:
    """A solid along the z axis about the origin."""

    kind: str
    half: Array  # edges, or twice the radius and the length without round ends; shape (3,) [m]

    @property
    def solid(self) -> Solid:
        """The solid; a mesh has the corners of a box."""
        if self.kind == "mesh":
            return hull_of_vertices("vertices", _CORNERS * self.half)
        sizes = {"sphere": self.half[:1], "box": 2.0 * self.half}
        return Solid(self.kind, sizes.get(self.kind, self.half[[0, 2]] * [1.0, 2.0]))

    @property
    def is_flat(self) -> bool:
        """Whether its sides are, of which it has four."""
        return self.kind in ("box", "mesh")

    @property
    def length(self) -> float:
        """Half of that of its sides [m]."""
        return 0.0 if self.kind == "sphere" else float(self.half[2])

    @property
    def reach(self) -> Array:
        """How far it reaches along the axes. Shape (3,) [m]."""
        if self.is_flat:
            return self.half
        end = self.length + (self.half[0] if self.kind in ("sphere", "capsule") else 0.0)
        return np.array([self.half[0], self.half[0], end])


def depth(one: Along, other: Along, middle: Array) -> float:
    """Of two along the same axes, of which each holds the other's middle, or nearly so [m].

    Of round ones from the nearest points of their middle lines, else across a side or an end: in
    between the way out is that across both, each times a sine or cosine, and longer.
    """
    radii = one.half[0] + other.half[0]
    if {one.kind, other.kind} <= {"sphere", "capsule"}:
        beyond = max(abs(middle[2]) - one.length - other.length, 0.0)
        return float(radii - np.hypot(np.hypot(*middle[:2]), beyond))
    ways = one.reach + other.reach - np.abs(middle)
    if not (one.is_flat or other.is_flat):
        ways[:2] = radii - np.hypot(*middle[:2])
    return float(ways.min())


def depths_of_core(
    rng: np.random.Generator, one: Along, others: Sequence[tuple[Along, Array, Rotation]]
) -> Array:
    """The core's depths of others, in places and turns about a solid; all of it in a drawn pose."""
    robot, frame, at = random_robot(1), Rotation.random(rng=rng), rng.normal(size=3)
    q = configurations(robot, 1, 1)
    q[0, :7] = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    placement, solid = pin.SE3(frame.as_matrix(), at), one.solid
    body = Body("one", "bus", 1, solid.geometry, placement, placement.act(solid.center), 20.0)
    alone = replace(robot, bodies=(body,), pairs=())
    seen = tuple(
        Obstacle(
            str(number),
            other.solid,
            RigidMotion(at + frame.apply(middle), (frame * turn).as_quat()),
        )
        for number, (other, middle, turn) in enumerate(others)
    )
    rows = distances_of_core(alone, q, np.zeros(1), seen, FAR)
    return -rows.values[np.argsort(rows.names)]


@pytest.mark.parametrize("other_kind", KINDS)
@pytest.mark.parametrize("kind", KINDS)
def test_nearly_parallel_solids_are_as_deep_in_each_other_as_parallel_ones(
    kind: str, other_kind: str, times: Callable[[int, int], int]
) -> None:
    """Some thousands every day; those whose middles are nearly in one axis among them."""
    rng = np.random.default_rng([KINDS.index(kind), KINDS.index(other_kind)])
    for case in range(times(10, 100)):
        one, others, truth, moved = Along(kind, 10.0 ** rng.uniform(-1.3, 0.0, 3)), [], [], []
        for _ in range(OF_EACH):
            other = Along(other_kind, 10.0 ** rng.uniform(-1.3, 0.0, 3))
            middle = rng.uniform(-0.6, 0.6, 3) * np.minimum(one.reach, other.reach)
            middle *= 10.0 ** (rng.integers(2, size=3) * rng.uniform(-12.0, 0.0, 3))
            tilt = 10.0 ** rng.uniform(-12.0, -2.0)
            about = rng.normal(size=3)
            turn = Rotation.from_rotvec(tilt * about / np.linalg.norm(about))
            others.append((other, middle, turn))
            truth.append(depth(one, other, middle))
            moved.append(tilt * np.linalg.norm(other.reach))
        off = np.abs(depths_of_core(rng, one, others) - truth)
        assert (off <= EXACT + np.array(moved)).all(), (case, off - moved)


@pytest.mark.parametrize(
    ("middle", "quaternion", "truth"),
    [
        ((0.006, 0.0, 0.109), (5e-6, 1.5e-6, 0.0, 1.0), 0.174),
        ((-0.005, -0.082, 0.041), (-5e-7, 1.5e-6, 0.0, 1.0), 0.0978477),
    ],
)
def test_nearly_parallel_cylinders_whose_polytope_was_torn(
    middle: tuple[float, ...], quaternion: tuple[float, ...], truth: float
) -> None:
    """Of their radii, 0.18 m together, the distance of their axes is taken away."""
    one, other = (Along("cylinder", np.array(half)) for half in ([0.1, 0, 0.2], [0.08, 0, 0.15]))
    place = other, np.array(middle), Rotation.from_quat(quaternion)
    rng = np.random.default_rng(1)
    for _ in range(50):
        assert depths_of_core(rng, one, [place]) == pytest.approx(truth, abs=3e-6)
