"""Distances of the arm's centre lines from spheres, against geometry."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from paper_equations import paper_terms
from robots import LEMUR_URDF, random_state, random_urdf
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.clearance import (
    arm_points,
    arm_points_with_derivatives,
    clearance_gradients,
    clearances,
    penalty,
    segments,
)
from ff_planner_ros.planning.problem.obstacles import Obstacle
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text

URDFS = {
    "lemur": (LEMUR_URDF.read_text(), "chaser", "end_effector"),
    "nine joints": (random_urdf(9, seed=9), "bus", "tool"),
}
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
# One segment from the origin to (2, 0, 0).
SEGMENT = np.array([[[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]])


@pytest.fixture(params=list(URDFS))
def urdf(request: pytest.FixtureRequest) -> tuple[str, str, str]:
    return URDFS[request.param]


def sphere(center: Array | list[float], radius: float) -> Obstacle:
    return Obstacle.sphere("sphere", np.array(center), radius)


def random_configurations(robot: Robot, count: int, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return np.array([configuration(robot, random_state(robot, rng))[0] for _ in range(count)])


def random_spheres(positions: Array, count: int, seed: int) -> tuple[Obstacle, ...]:
    """Around the arm, some of them in its way, all of them moving."""
    rng = np.random.default_rng(seed)
    centers = positions.reshape(-1, 3)[rng.integers(positions.size // 3, size=count)]
    centers = centers + rng.normal(scale=0.3, size=(count, 3))
    return tuple(
        Obstacle.sphere("sphere", center, rng.uniform(0.05, 0.4), rng.normal(scale=0.05, size=3))
        for center in centers
    )


def times_of(positions: Array) -> Array:
    return np.linspace(0.0, 2.0, len(positions))


def test_arm_points_are_the_joint_origins_and_the_end_effector(urdf: tuple[str, str, str]) -> None:
    robot = robot_from_urdf_text(*urdf)
    rng = np.random.default_rng(1)
    states = [random_state(robot, rng) for _ in range(4)]
    q = np.array([configuration(robot, state)[0] for state in states])
    positions = arm_points(robot, q)
    for i, state in enumerate(states):
        attitude = Rotation.from_quat(state.quaternion_chaser_to_inertial_xyzw.copy())
        paper = paper_terms(
            *urdf,
            r_ch=state.position_chaser_in_inertial,
            rotation_ch=attitude.as_matrix(),
            theta=state.joint_positions,
        )
        np.testing.assert_allclose(
            positions[i],
            [*paper.r_joint, paper.r_ee],
            rtol=0.0,
            atol=1e-12,
            err_msg=f"state {i}",
        )
    together, _ = arm_points_with_derivatives(robot, q, np.zeros((4, 6 + robot.joints, 1)))
    np.testing.assert_allclose(together, positions, rtol=0.0, atol=1e-14)


def test_derivatives_of_arm_points_are_those_of_differences(urdf: tuple[str, str, str]) -> None:
    robot = robot_from_urdf_text(*urdf)
    q = random_configurations(robot, count=5, seed=2)
    sensitivity = np.random.default_rng(2).normal(size=(5, 6 + robot.joints, 3))
    _, found = arm_points_with_derivatives(robot, q, sensitivity)
    step = 1e-5
    for k in range(3):
        expected = (
            arm_points(robot, aside(robot, q, step * sensitivity[:, :, k]))
            - arm_points(robot, aside(robot, q, -step * sensitivity[:, :, k]))
        ) / (2 * step)
        error = np.abs(found[..., k] - expected).max() / np.abs(expected).max()
        assert error < 1e-6, f"column {k}: relative error {error:.1e}"


def aside(robot: Robot, q: Array, steps: Array) -> Array:
    """Each configuration, a tangent step further."""
    return np.array([pin.integrate(robot.model, *pair) for pair in zip(q, steps, strict=True)])


@pytest.mark.parametrize(
    ("center", "distance", "fraction", "direction"),
    [
        ([0.5, 3.0, 0.0], 3.0, 0.25, [0.0, -1.0, 0.0]),
        ([1.0, 0.0, -2.0], 2.0, 0.5, [0.0, 0.0, 1.0]),
        ([-3.0, 4.0, 0.0], 5.0, 0.0, [0.6, -0.8, 0.0]),
        ([2.0 + 1.2, 0.0, 1.6], 2.0, 1.0, [-0.6, 0.0, -0.8]),
        ([5.0, 0.0, 0.0], 3.0, 1.0, [-1.0, 0.0, 0.0]),
    ],
    ids=["beside", "below the middle", "before the start", "beyond the end", "straight ahead"],
)
def test_the_nearest_point_is_found_wherever_it_lies(
    center: list[float], distance: float, fraction: float, direction: list[float]
) -> None:
    clear = clearances(SEGMENT, np.zeros(1), np.array([0]), [sphere(center, 0.75)])
    assert clear.distance.shape == clear.fraction.shape == (1, 1, 1)
    assert clear.distance[0, 0, 0] == pytest.approx(distance - 0.75, abs=1e-15)
    assert clear.fraction[0, 0, 0] == pytest.approx(fraction, abs=1e-15)
    np.testing.assert_allclose(clear.direction[0, 0, 0], direction, rtol=0.0, atol=1e-15)


def test_a_sphere_centred_on_the_arm_is_penetrated_by_its_radius_and_nothing_is_infinite() -> None:
    clear = clearances(SEGMENT, np.zeros(1), np.array([0]), [sphere([0.5, 0.0, 0.0], 0.75)])
    assert clear.distance[0, 0, 0] == -0.75
    assert np.isfinite(clear.direction).all()


def test_distances_are_those_of_densely_sampled_segments(urdf: tuple[str, str, str]) -> None:
    robot = robot_from_urdf_text(*urdf)
    positions = arm_points(robot, random_configurations(robot, count=4, seed=3))
    spheres, starts = random_spheres(positions, count=6, seed=3), segments(positions)
    clear = clearances(positions, times_of(positions), starts, spheres)
    assert clear.distance.shape == (4, len(starts), 6)
    fractions = np.linspace(0.0, 1.0, 2001)[:, None]
    for point, segment, number in np.ndindex(clear.distance.shape):
        start, end = positions[point, starts[segment]], positions[point, starts[segment] + 1]
        samples = start + fractions * (end - start)
        center = (
            spheres[number].center + times_of(positions)[point] * spheres[number].motion.velocity
        )
        to_center = np.linalg.norm(samples - center, axis=1)
        sampled = to_center.min() - spheres[number].radius
        found = clear.distance[point, segment, number]
        where = f"point {point}, segment {segment}, sphere {number}"
        # Samples never find less than the truth, and miss it by half their spacing at most.
        gap = np.linalg.norm(end - start) / 4000
        assert found - 1e-12 <= sampled <= found + gap, f"{where}: {found} is not {sampled}"
        assert abs(clear.fraction[point, segment, number] - fractions[to_center.argmin(), 0]) < (
            1e-3
        ), where


def test_gradients_of_distances_are_those_of_differences(urdf: tuple[str, str, str]) -> None:
    robot = robot_from_urdf_text(*urdf)
    q = random_configurations(robot, count=6, seed=4)
    sensitivity = np.random.default_rng(4).normal(size=(6, 6 + robot.joints, 3))
    positions, derivatives = arm_points_with_derivatives(robot, q, sensitivity)
    spheres, starts = random_spheres(positions, count=5, seed=4), segments(positions)
    clear = clearances(positions, times_of(positions), starts, spheres)
    assert np.any(clear.fraction == 0.0)
    assert np.any(clear.fraction == 1.0)
    assert np.any((clear.fraction > 0.0) & (clear.fraction < 1.0))
    rows = np.nonzero(clear.distance < 2.0)
    found = clearance_gradients(clear, derivatives, starts, rows)
    assert found.shape == (len(rows[0]), 3)
    step = 1e-6
    for k in range(3):
        ahead, behind = (
            clearances(
                arm_points(robot, aside(robot, q, sign * step * sensitivity[:, :, k])),
                times_of(q),
                starts,
                spheres,
            ).distance[rows]
            for sign in (1, -1)
        )
        expected = (ahead - behind) / (2 * step)
        errors = np.abs(found[:, k] - expected)
        worst = errors.argmax()
        assert errors[worst] < 1e-6 * np.abs(expected).max(), (
            f"column {k}, at (point, segment, sphere) {[index[worst] for index in rows]}: "
            f"{found[worst, k]} is not {expected[worst]}"
        )


def test_segments_without_length_are_left_out(lemur: Robot) -> None:
    """Joints 2 and 3 share their origin, as do the wrist's three and the end effector."""
    positions = arm_points(lemur, random_configurations(lemur, count=2, seed=5))
    np.testing.assert_array_equal(segments(positions), [0, 2, 3])


def test_every_segment_of_some_length_is_kept() -> None:
    robot = robot_from_urdf_text(*URDFS["nine joints"])
    positions = arm_points(robot, random_configurations(robot, count=1, seed=6))
    np.testing.assert_array_equal(segments(positions), np.arange(9))


@pytest.mark.parametrize("exponent", [1.0, 2.0])
def test_the_penalty_is_that_of_eqs_46_and_47(exponent: float) -> None:
    robot = robot_from_urdf_text(*URDFS["lemur"])
    nearby = np.random.default_rng(7).normal(scale=0.1, size=(8, 13))
    one = random_configurations(robot, count=1, seed=7)
    positions = arm_points(robot, aside(robot, np.repeat(one, 8, axis=0), nearby))
    # Around the elbow two segments are inside, of which the paper counts the deeper.
    spheres = tuple(sphere(positions[0, k] + 0.15, 0.3) for k in (0, 3, 4))
    starts = segments(positions)
    distance = clearances(positions, times_of(positions), starts, spheres).distance
    assert np.any((distance < 0.0).sum(axis=1) > 1)
    expected, g1, hits = 0.0, 2.5, 0
    for k, obstacle in enumerate(spheres):
        for i in range(len(positions)):
            delta = min(distance[i, j, k] for j in range(len(starts))) + obstacle.radius
            if delta < obstacle.radius:
                expected += g1 * (obstacle.radius - delta) ** exponent
                hits += 1
    assert 5 < hits < 24  # some of the 8 x 3, not all
    assert penalty(distance, g1, exponent) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("exponent", [0.0, 1.0])
def test_an_arm_that_only_touches_pays_nothing(exponent: float) -> None:
    assert penalty(np.array([[[0.0], [0.2]]]), 2.5, exponent) == 0.0


def test_without_spheres_there_are_no_distances_and_no_penalty(lemur: Robot) -> None:
    positions, derivatives = arm_points_with_derivatives(
        lemur, random_configurations(lemur, count=3, seed=8), np.ones((3, 13, 2))
    )
    starts = segments(positions)
    clear = clearances(positions, times_of(positions), starts, ())
    assert clear.distance.shape == (3, 3, 0)
    assert clearance_gradients(clear, derivatives, starts, np.nonzero(clear.distance)).shape == (
        0,
        2,
    )
    assert penalty(clear.distance, 2.5, 1.0) == 0.0
