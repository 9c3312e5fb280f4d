"""Lower bounds between two times, against exact distances of solids that move past each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin
import pytest
from bodied_robots import body_placements, coal_distance, collision, random_solid
from exact_solids import Placed, signed_distance
from near_bodies import least_distance
from scipy.spatial.transform import Rotation
from straight_arms import ball, straight_arm, told

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.body_certificate import CHECK_GAP
from ff_planner_ros.planning.distance.body_gaps import Solids, arcs_of, measured
from ff_planner_ros.planning.distance.solids_apart import Distances
from ff_planner_ros.planning.motion.certified_least import Known, Pieces, parabola_bounds
from ff_planner_ros.planning.problem.problem import Obstacle, RigidMotion
from ff_planner_ros.robot.collision.solids import Solid

KINDS = ("box", "sphere", "cylinder", "capsule", "cone", "mesh")
PARTS = np.linspace(0.0, 1.0, 6)
STILL = pin.SE3.Identity()


@dataclass(frozen=True)
class Passing:
    """A solid that turns steadily about its origin, which flies steadily past a resting one."""

    first: Solid
    second: Solid
    begin: pin.SE3  # of the second, in the frame of the first
    way: Array
    turn: Array

    def at(self, part: float) -> pin.SE3:
        """The second one's pose."""
        turned = pin.exp3(part * self.turn) @ self.begin.rotation
        return pin.SE3(turned, self.begin.translation + part * self.way)

    def distance(self, part: float) -> float:
        there = self.at(part)
        return signed_distance(
            Placed(self.first, STILL.rotation, STILL.translation),
            Placed(self.second, there.rotation, there.translation),
        )[0]

    def seen(self, part: float, normal: Array) -> Known:
        there = self.at(part)
        found = Distances(np.array([self.distance(part)]), np.zeros((1, 3)), normal[None])
        first, second = ((one.rotation[None], one.translation[None]) for one in (STILL, there))
        return measured(found, first, second)

    @property
    def bends(self) -> Array:
        """The second's points are on circles; as it sees them, the first's are on spirals."""
        rate, speed = float(np.linalg.norm(self.turn)), float(np.linalg.norm(self.way))
        away = max(float(np.linalg.norm(self.at(end).translation)) for end in (0.0, 1.0))
        seen = rate**2 * (away + self.first.reach) + 2 * rate * speed
        return np.array([[rate**2 * self.second.reach], [seen]])

    def bound(self, normals: Sequence[Array]) -> float:
        """What is certified of the distance, by a normal at the begin and one at the end."""
        ends = (self.seen(part, normal) for part, normal in zip((0.0, 1.0), normals, strict=True))
        none = np.zeros(1, np.intp)
        first, second = (Solids([one.geometry], none) for one in (self.first, self.second))
        pieces = Pieces(none, np.zeros(1), np.ones(1), *ends)
        return float(parabola_bounds(*arcs_of(first, second, pieces, self.bends)).max())

    def normals(self) -> list[Array]:
        """Coal's at both ends."""
        found = []
        for part in (0.0, 1.0):
            result, there = coal.DistanceResult(), self.at(part)
            places = [coal.Transform3s(at.rotation, at.translation) for at in (STILL, there)]
            solids = self.first.geometry, self.second.geometry
            coal.distance(
                solids[0], places[0], solids[1], places[1], coal.DistanceRequest(), result
            )
            found.append(np.array(result.normal))
        return found


def direction(rng: np.random.Generator) -> Array:
    found = rng.normal(size=3)
    return np.asarray(found / np.linalg.norm(found))


def random_passing(rng: np.random.Generator, first: Solid, second: Solid, size: float) -> Passing:
    """A pair near each other, or in each other, half-way."""
    turned, aside = Rotation.random(random_state=rng).as_matrix(), direction(rng)
    apart = first.furthest(aside[None])[0] + second.furthest(-aside[None] @ turned)[0]
    way, turn = 0.1 * size * rng.normal(size=3), size * rng.normal(size=3)
    place = (apart + rng.choice([0.0, 0.002, -0.02, 0.1])) * aside - way / 2
    return Passing(first, second, pin.SE3(turned, place), way, turn)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("other", KINDS)
def test_no_bound_is_above_any_distance_on_the_way(kind: str, other: str) -> None:
    """By Coal's normals, and by any: also of solids that touch, thin ones among them."""
    rng = np.random.default_rng(KINDS.index(kind) * 10 + KINDS.index(other))
    for size in (0.02, 0.2, 1.0):
        one = random_passing(rng, random_solid(rng, kind), random_solid(rng, other), size)
        least = min(map(one.distance, PARTS.tolist()))
        for normals in (one.normals(), [direction(rng), direction(rng)], [np.zeros(3)] * 2):
            assert one.bound(normals) <= least + 1e-7


@pytest.mark.parametrize(
    "turn", [np.zeros(3), np.array([0.0, 0.0, 0.3]), np.array([0.2, 0.0, 0.0])]
)
@pytest.mark.parametrize("height", [0.004, 0.0, -0.001])
def test_a_ball_that_flies_along_a_plate_is_as_far_as_it_is(height: float, turn: Array) -> None:
    """Turning it costs what its own points bend, and the normal at one end is enough."""
    plate, rock = Solid("box", np.array([3.0, 2.0, 0.01])), Solid("sphere", np.array([0.1]))
    begin = pin.SE3(np.eye(3), np.array([-0.9, 0.3, 0.105 + height]))
    one = Passing(plate, rock, begin, np.array([1.8, 0.0, 0.0]), turn)
    up = np.array([0.0, 0.0, 1.0])
    centred = np.dot(turn, turn) * 0.1 / 8
    assert one.bound([up, up]) == pytest.approx(height - centred, abs=1e-12)
    aside = np.array([0.6, 0.0, 0.8])
    assert one.bound([up, aside]) == pytest.approx(height - centred, abs=1e-12)
    assert one.bound([aside, up]) == pytest.approx(height - centred, abs=1e-12)
    turned = Passing(rock, plate, begin.inverse(), -one.way, np.zeros(3))
    assert turned.bound([-up, -up]) == pytest.approx(height, abs=1e-12)


def test_a_plate_that_turns_past_a_ball_loses_what_it_bends_and_no_more() -> None:
    """Its face stays the nearest part, though its rim moves by ten centimetres."""
    plate, rock = Solid("box", np.array([2.0, 2.0, 0.01])), Solid("sphere", np.array([0.2]))
    turn = np.array([0.0, 0.1, 0.0])
    begin = pin.SE3(pin.exp3(-turn / 2), np.array([0.0, 0.0, -0.215]))
    one = Passing(rock, plate, begin, np.zeros(3), turn)
    # Either end: the ball's centre is 0.215 m from the plate's, at a slant of 0.05.
    at_ends, bend = 0.215 * np.cos(0.05) - 0.205, 0.1**2 * (0.215 + 0.2)
    assert one.distance(0.5) == pytest.approx(0.01, abs=1e-9)
    begin_normal, end_normal = one.normals()
    aside = np.array([0.0, 0.6, -0.8])
    for normals in ([begin_normal, end_normal], [begin_normal, aside], [aside, end_normal]):
        assert one.bound(normals) == pytest.approx(at_ends - bend / 8, abs=1e-9)


@pytest.mark.law("PLAN-09")
@pytest.mark.parametrize("spin", [0.0, 0.4, -0.8])
def test_a_hand_that_passes_thin_plates_which_turn_is_certified_closely(spin: float) -> None:
    """Each pair by itself, against Coal at many times: the robot turns, and so do the plates."""
    rod = collision("cylinder", 'radius="0.04" length="0.9"', "0.5 0 0", "0 1.5708 0")
    hand = collision("box", 'size="0.3 0.1 0.02"', "0.4 0 0", "0.3 0.2 0")
    arm = straight_arm(0.0, 1.0, 0.6, solids=(("link_1", rod), ("link_2", hand)))

    def configurations(times: Array) -> Array:
        base = np.zeros((len(times), 7))
        base[:, 5], base[:, 6] = np.sin(0.1 * times), np.cos(0.1 * times)
        return np.hstack([base, begin + np.outer(times, rates)])

    begin, rates = np.array([0.1, 0.4]), np.array([0.5, -0.3])
    times, fine = np.linspace(0.0, 2.0, 21), np.linspace(0.0, 2.0, 801)
    q, twist = configurations(times), np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.2])
    motion = told(times, q[:, 7:], np.tile(rates, (21, 1)), q[:, :7], np.tile(twist, (21, 1)))
    plates = tuple(
        Obstacle(
            str(number),
            Solid("box", np.array([0.5, 0.4, 0.004])),
            RigidMotion(
                [1.2 + 0.1 * number, 0.5, 0.3 - 0.15 * number],
                Rotation.from_rotvec([0.5 * number, 0.2, 0.0]).as_quat(),
                [0.0, 0.02 * number, 0.0],
                [0.1 * spin, spin, 0.3 * spin],
            ),
        )
        for number in range(5)
    )
    bodies = [body_placements(arm, at) for at in configurations(fine)]
    near = 0
    for number in range(len(arm.bodies) * len(plates)):
        body, plate = divmod(number, len(plates))
        solids = arm.bodies[body].solid, plates[plate].solid.geometry
        places = [pin.SE3(*pose) for pose in zip(*plates[plate].motion.poses(fine), strict=True)]
        dense = min(
            coal_distance(solids[0], at[body], solids[1], there)
            for at, there in zip(bodies, places, strict=True)
        )
        least = least_distance(arm, motion, plates, np.array([number]), len(times) - 1)
        exact = CHECK_GAP
        assert least.found - exact <= least.certified <= dense + 1e-6
        near += dense < 0.05
    assert near > 2


def test_what_flies_along_a_face_is_certified_to_be_as_far_as_it_is() -> None:
    """By its way alone it would be certified to less, by up to the gap."""
    chaser = collision("box", 'size="2 2 2"')
    arm = straight_arm(0.0, 5.0, solids=(("chaser", chaser), ("link_1", ball(0.1, 5.0))))
    times, still = np.linspace(0.0, 2.0, 21), np.zeros((21, 1))
    motion, last = told(times, still, still), len(times) - 1
    place, velocity = [-0.7, 0.2, 1.103], [0.7, -0.1, 0.0]
    flying = Obstacle.sphere("ball", place, 0.1, velocity)
    least = least_distance(arm, motion, [flying], np.zeros(1, np.intp), last)
    assert least.certified == pytest.approx(0.003, abs=2.1e-6)
    turned = Obstacle(
        "box", Solid("box", np.array([0.3, 0.1, 0.2])), RigidMotion(place, velocity=velocity)
    )
    least = least_distance(arm, motion, [turned], np.zeros(1, np.intp), last)
    assert least.certified == pytest.approx(0.003, abs=3e-6)
