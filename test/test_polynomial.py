"""The end effector's path: end conditions, the paper's coefficients, derivatives, readings."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from reference_end_effector import acceleration_of, twist_derivative, twist_of
from robots import end_effector_polynomial
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.paths.polynomial import (
    EndEffectorMotion,
    EndEffectorPolynomial,
    end_effector_polynomials,
)
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.robot.configuration import configuration

DURATIONS = (0.5, 10.0, 600.0)
READINGS = ("inertial", "along_turn")
STRAIGHT = np.zeros((6, 3))
TIMES = np.linspace(0.03, 0.97, 13)


def rotation(*euler_xyz_deg: float) -> Array:
    """From angles as the paper prints them."""
    return Rotation.from_euler("ZYX", euler_xyz_deg[::-1], degrees=True).as_matrix()


def motion(rng: np.random.Generator, rotation_ee_to_inertial: Array) -> EndEffectorMotion:
    """A hand on its way, at speeds and accelerations of a tangent capture and more."""
    return EndEffectorMotion(
        position=rng.uniform(-2.0, 2.0, 3),
        rotation_ee_to_inertial=rotation_ee_to_inertial,
        twist=rng.normal(scale=0.2, size=6),
        acceleration=rng.normal(scale=0.05, size=6),
    )


def at_rest(rotation_ee_to_inertial: Array) -> EndEffectorMotion:
    zero = np.zeros(6)
    return EndEffectorMotion(np.zeros(3), rotation_ee_to_inertial, zero, zero)


def random_ends(reading: str, seed: int) -> tuple[EndEffectorMotion, EndEffectorMotion]:
    """Two ends between which the orientation is read as said."""
    rng = np.random.default_rng(seed)
    # At 70 deg the paper's angles are still good, at 90 deg they are not.
    pitch = rng.uniform(-70.0, 70.0) if reading == "inertial" else 90.0
    roll, yaw = rng.uniform(-180.0, 180.0, (2, 2))
    start = rotation(roll[0], rng.uniform(-70.0, 70.0), yaw[0])
    return motion(rng, start), motion(rng, rotation(roll[1], pitch, yaw[1]))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("duration", DURATIONS)
@pytest.mark.parametrize("reading", READINGS)
def test_the_end_conditions_hold_for_any_coefficients(
    reading: str, duration: float, seed: int
) -> None:
    start, end = random_ends(reading, seed)
    path = end_effector_polynomial(start, end, duration)
    # A hand that turns at 0.2 rad/s for minutes overshoots any pitch.
    assert path.reading == ("along_turn" if duration > 100.0 else reading)
    coefficients = np.random.default_rng(seed).normal(scale=0.5, size=(6, 3))
    s = np.array([0.0, 1.0])
    position, orientation = path.pose(coefficients, s)
    twist, acceleration = twist_of(path, coefficients, s), acceleration_of(path, coefficients, s)
    # The hand's own speed takes it up to 0.1 * 600^2 m away between the ends: of terms of that
    # size the sixteenth digit is left.
    tolerance = max(1e-10, 4e-15 * float(np.abs(path.quintic).max()))
    for i, wanted in enumerate((start, end)):
        for name, found, expected in (
            ("position", position[i], wanted.position),
            ("orientation", orientation[i], wanted.rotation_ee_to_inertial),
            ("twist", twist[i], wanted.twist),
            ("acceleration", acceleration[i], wanted.acceleration),
        ):
            error = np.abs(found - expected).max()
            assert error < tolerance, f"{name} at s = {s[i]}: {error:.1e} > {tolerance:.1e}"


def test_an_approach_of_ten_minutes_ends_where_it_should_to_1e_10() -> None:
    """The speeds of a slow approach, where nothing but the polynomial limits the accuracy."""
    for seed in range(10):
        ends = [
            EndEffectorMotion(
                end.position,
                end.rotation_ee_to_inertial,
                end.twist / 600.0,
                end.acceleration / 600.0**2,
            )
            for end in random_ends("inertial", seed)
        ]
        path = end_effector_polynomial(ends[0], ends[1], 600.0)
        s = np.array([0.0, 1.0])
        position, orientation = path.pose(np.ones((6, 3)), s)
        for name, found in (
            ("position", position),
            ("rotation_ee_to_inertial", orientation),
            ("twist", twist_of(path, np.ones((6, 3)), s)),
            ("acceleration", acceleration_of(path, np.ones((6, 3)), s)),
        ):
            expected = np.array([getattr(end, name) for end in ends])
            np.testing.assert_allclose(
                found, expected, rtol=0.0, atol=1e-10, err_msg=f"{name}, seed {seed}"
            )


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("duration", DURATIONS)
@pytest.mark.parametrize("reading", READINGS)
def test_the_decision_variables_are_the_paper_s(reading: str, duration: float, seed: int) -> None:
    """Eqs. (33) and (36)-(42) in seconds, with xi given, are the same path."""
    start, end = random_ends(reading, seed)
    path = end_effector_polynomial(start, end, duration)
    coefficients = np.random.default_rng(seed).normal(scale=0.5, size=(6, 3))
    xi = path.decision_variables(coefficients)
    assert xi.shape == (18,)
    (p0, pd0, pdd0), (pf, pdf, pddf) = (end_conditions(path, one) for one in (start, end))
    turns = np.round((pf[3:] - p0[3:]) / (2 * np.pi))
    pf[3:] -= 2 * np.pi * turns

    tf = duration
    a6, a7, a8 = xi.reshape(6, 3).T
    a0 = p0
    a1 = pd0
    a2 = pdd0 / 2
    a3 = (
        20 * (pf - p0) - (12 * pd0 + 8 * pdf) * tf - (3 * pdd0 - pddf) * tf**2
        - 2 * a6 * tf**6 - 6 * a7 * tf**7 - 12 * a8 * tf**8
    ) / (2 * tf**3)  # fmt: skip
    a4 = (
        -30 * (pf - p0) + (16 * pd0 + 14 * pdf) * tf + (3 * pdd0 - 2 * pddf) * tf**2
        + 6 * a6 * tf**6 + 16 * a7 * tf**7 + 30 * a8 * tf**8
    ) / (2 * tf**4)  # fmt: skip
    a5 = (
        12 * (pf - p0) - 6 * (pd0 + pdf) * tf - (pdd0 - pddf) * tf**2
        - 6 * a6 * tf**6 - 12 * a7 * tf**7 - 20 * a8 * tf**8
    ) / (2 * tf**5)  # fmt: skip
    t = TIMES[:, None] * tf
    terms = [a * t**k for k, a in enumerate((a0, a1, a2, a3, a4, a5, a6, a7, a8))]
    p = sum(terms)

    tolerance = 1e-14 * max(float(np.abs(term).max()) for term in terms) + 1e-13
    position, orientation = path.pose(coefficients, TIMES)
    np.testing.assert_allclose(position, p[:, :3], rtol=0.0, atol=tolerance)
    turn = Rotation.from_euler("ZYX", p[:, :2:-1]).as_matrix()
    expected = path.rotation_outer @ turn @ path.rotation_inner
    np.testing.assert_allclose(orientation, expected, rtol=0.0, atol=tolerance)


def end_conditions(path: EndEffectorPolynomial, end: EndEffectorMotion) -> list[Array]:
    """p, its rate and its acceleration at one end, as the paper's Eq. (3) maps them."""
    outer, inner = path.rotation_outer, path.rotation_inner
    relative = outer.T @ end.rotation_ee_to_inertial @ inner.T
    phi, theta, psi = Rotation.from_matrix(relative).as_euler("ZYX")[::-1]
    omega, alpha = outer.T @ end.twist[3:], outer.T @ end.acceleration[3:]
    # The three axes about which the angles turn, in the resting frame, last rotation first.
    z = np.array([0.0, 0.0, 1.0])
    y = np.array([-np.sin(psi), np.cos(psi), 0.0])
    x = np.array([np.cos(psi) * np.cos(theta), np.sin(psi) * np.cos(theta), -np.sin(theta)])
    axes = np.column_stack([x, y, z])
    rates = np.linalg.solve(axes, omega)
    phi_rate, theta_rate, psi_rate = rates
    # Each axis is carried by the rotations that are outside of it.
    y_rate = np.cross(psi_rate * z, y)
    x_rate = np.cross(psi_rate * z + theta_rate * y, x)
    accelerations = np.linalg.solve(axes, alpha - x_rate * phi_rate - y_rate * theta_rate)
    return [
        np.concatenate([end.position, [phi, theta, psi]]),
        np.concatenate([end.twist[:3], rates]),
        np.concatenate([end.acceleration[:3], accelerations]),
    ]


@pytest.mark.parametrize("duration", DURATIONS)
@pytest.mark.parametrize("reading", READINGS)
def test_twist_and_acceleration_are_the_rates_of_pose_and_twist(
    reading: str, duration: float
) -> None:
    rng = np.random.default_rng(5)
    start, end = random_ends(reading, 5)
    slow = [at_speed(one, 1.0 / duration) for one in (start, end)]
    path = end_effector_polynomial(slow[0], slow[1], duration)
    coefficients = rng.normal(scale=0.3, size=(6, 3))
    step = 1e-5
    (p_behind, r_behind), (p_ahead, r_ahead) = (
        path.pose(coefficients, TIMES + aside) for aside in (-step, step)
    )
    seconds = 2 * step * duration
    turn = [pin.log3(b @ a.T) for a, b in zip(r_behind, r_ahead, strict=True)]
    twist = np.concatenate([p_ahead - p_behind, np.array(turn)], axis=1) / seconds
    found = twist_of(path, coefficients, TIMES)
    np.testing.assert_allclose(found, twist, rtol=0.0, atol=1e-7 * np.abs(twist).max())
    ahead, behind = (twist_of(path, coefficients, TIMES + aside) for aside in (step, -step))
    acceleration = (ahead - behind) / seconds
    found = acceleration_of(path, coefficients, TIMES)
    np.testing.assert_allclose(
        found, acceleration, rtol=0.0, atol=1e-7 * np.abs(acceleration).max()
    )


def at_speed(end: EndEffectorMotion, factor: float) -> EndEffectorMotion:
    """The same end, met faster or slower."""
    return EndEffectorMotion(
        end.position,
        end.rotation_ee_to_inertial,
        end.twist * factor,
        end.acceleration * factor**2,
    )


@pytest.mark.parametrize("duration", DURATIONS)
@pytest.mark.parametrize("reading", READINGS)
def test_the_twist_s_derivative_is_that_of_differences(reading: str, duration: float) -> None:
    path = end_effector_polynomial(*random_ends(reading, 6), duration)
    coefficients = np.random.default_rng(6).normal(scale=0.3, size=18)
    step = 1e-5
    found = twist_derivative(path, coefficients.reshape(6, 3), TIMES)
    assert found.shape == (len(TIMES), 6, 18)
    for k, aside in enumerate(step * np.eye(18)):
        ahead, behind = (
            twist_of(path, (coefficients + sign * aside).reshape(6, 3), TIMES) for sign in (1, -1)
        )
        expected = (ahead - behind) / (2 * step)
        error = np.abs(found[:, :, k] - expected).max() / np.abs(expected).max()
        assert error < 1e-6, f"coefficient {k}: relative error {error:.1e}"


def test_the_paper_s_capture_is_read_as_in_the_paper(lemur_capture: PlanningProblem) -> None:
    robot = lemur_capture.robot
    q, _ = configuration(robot, lemur_capture.start)
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    placement = data.oMf[robot.tip_frame_id]
    zero = np.zeros(6)
    start = EndEffectorMotion(placement.translation, placement.rotation, zero, zero)
    goal = pin.Quaternion(lemur_capture.target.quaternion_xyzw).toRotationMatrix()
    end = EndEffectorMotion(lemur_capture.target.position, goal, zero, zero)
    path = end_effector_polynomial(start, end, lemur_capture.duration)
    assert path.reading == "inertial"
    np.testing.assert_array_equal(path.rotation_outer, np.eye(3))
    np.testing.assert_array_equal(path.rotation_inner, np.eye(3))
    value, _, _ = path.components(STRAIGHT, np.array([0.0, 1.0]))
    np.testing.assert_allclose(
        np.rad2deg(value[:, 3:]), [[-45.0, 55.0, -65.0], [-65.0, 80.0, -85.0]], atol=0.011
    )


@pytest.mark.parametrize("turn_deg", [0.0, 1e-4, 30.0, 90.0, 150.0, 170.0])
@pytest.mark.parametrize("pitch_deg", [-90.0, 88.0, 90.0])
@pytest.mark.parametrize("where", ["start", "end"])
def test_an_end_next_to_the_singularity_is_read_along_the_turn(
    where: str, pitch_deg: float, turn_deg: float
) -> None:
    rng = np.random.default_rng(int(turn_deg))
    steep = rotation(20.0, pitch_deg, -40.0)
    axis = rng.normal(size=3)
    turn = pin.exp3(np.deg2rad(turn_deg) * axis / np.linalg.norm(axis))
    rotations = (steep, steep @ turn) if where == "start" else (steep @ turn, steep)
    path = end_effector_polynomial(motion(rng, rotations[0]), motion(rng, rotations[1]), 10.0)
    assert path.reading == "along_turn"
    # The straight path between resting ends is about z alone: from zero to the whole turn.
    resting = end_effector_polynomial(at_rest(rotations[0]), at_rest(rotations[1]), 10.0)
    value, _, _ = resting.components(STRAIGHT, np.array([0.0, 1.0]))
    np.testing.assert_allclose(
        np.rad2deg(value[:, 3:]), [[0.0, 0.0, 0.0], [0.0, 0.0, turn_deg]], rtol=0.0, atol=1e-8
    )


def test_a_steep_hand_that_shall_not_turn_at_all_stays_as_it_is() -> None:
    steep = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    path = end_effector_polynomial(at_rest(steep), at_rest(steep), 10.0)
    assert path.reading == "along_turn"
    _, found = path.pose(STRAIGHT, TIMES)
    np.testing.assert_allclose(found, np.tile(steep, (len(TIMES), 1, 1)), rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("turn_deg", [10.0, 100.0, 170.0])
def test_the_straight_path_along_a_turn_is_the_geodesic(turn_deg: float) -> None:
    rng = np.random.default_rng(8)
    start = rotation(-10.0, 90.0, 50.0)
    axis = rng.normal(size=3)
    axis *= np.deg2rad(turn_deg) / np.linalg.norm(axis)
    path = end_effector_polynomial(at_rest(start), at_rest(start @ pin.exp3(axis)), 10.0)
    _, found = path.pose(STRAIGHT, TIMES)
    for s, one in zip(TIMES, found, strict=True):
        progress = 10 * s**3 - 15 * s**4 + 6 * s**5
        np.testing.assert_allclose(
            one, start @ pin.exp3(progress * axis), rtol=0.0, atol=1e-12, err_msg=f"s = {s}"
        )


@pytest.mark.parametrize("seed", range(8))
def test_along_the_turn_the_path_does_not_depend_on_the_inertial_frame(seed: int) -> None:
    rng = np.random.default_rng(seed)
    start, end = random_ends("along_turn", seed)
    steep = end.rotation_ee_to_inertial[:, 0]
    # Any rotation that leaves the start, or the end, or the end upside down, next to the
    # singularity; anywhere else the other reading is chosen.
    upright = (start.rotation_ee_to_inertial[:, 0], steep, -steep)[seed % 3]
    to_z = pin.Quaternion.FromTwoVectors(upright, np.array([0.0, 0.0, 1.0])).toRotationMatrix()
    turn = rotation(0.0, 0.0, rng.uniform(-180.0, 180.0)) @ to_z
    path = end_effector_polynomial(start, end, 10.0)
    turned_path = end_effector_polynomial(turned(start, turn), turned(end, turn), 10.0)
    assert path.reading == turned_path.reading == "along_turn"

    coefficients = rng.normal(scale=0.4, size=(6, 3))
    turned_coefficients = np.concatenate([turn @ coefficients[:3], coefficients[3:]])
    position, orientation = path.pose(coefficients, TIMES)
    turned_position, turned_orientation = turned_path.pose(turned_coefficients, TIMES)
    np.testing.assert_allclose(turned_position, position @ turn.T, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(turned_orientation, turn @ orientation, rtol=0.0, atol=1e-10)


def turned(end: EndEffectorMotion, turn: Array) -> EndEffectorMotion:
    """The same end, seen from a turned inertial frame."""
    return EndEffectorMotion(
        turn @ end.position,
        turn @ end.rotation_ee_to_inertial,
        (end.twist.reshape(2, 3) @ turn.T).ravel(),
        (end.acceleration.reshape(2, 3) @ turn.T).ravel(),
    )


def test_a_straight_path_that_overshoots_a_safe_pitch_is_read_along_the_turn() -> None:
    """Both ends are safe; the start's twist, 0.08 rad/s up in pitch, carries it beyond."""
    start, goal = at_rest(rotation(0.0, 82.0, 0.0)), at_rest(rotation(0.0, 55.0, 0.0))
    assert end_effector_polynomial(start, goal, 10.0).reading == "inertial"
    pitching = replace(start, twist=np.array([0.0, 0.0, 0.0, 0.0, 0.08, 0.0]))
    assert end_effector_polynomial(pitching, goal, 10.0).reading == "along_turn"


@pytest.mark.parametrize("angle", [0, 2])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_of_equal_angles_the_nearest_to_the_start_is_chosen(angle: int, side: float) -> None:
    start_deg, end_deg = np.array([10.0, 20.0, 30.0]), np.array([15.0, 25.0, 35.0])
    start_deg[angle], end_deg[angle] = side * 170.0, -side * 175.0
    start, end = at_rest(rotation(*start_deg)), at_rest(rotation(*end_deg))
    path = end_effector_polynomial(start, end, 10.0)
    value, _, _ = path.components(STRAIGHT, TIMES)
    end_deg[angle] += side * 360.0
    progress = 10 * TIMES**3 - 15 * TIMES**4 + 6 * TIMES**5
    expected = start_deg + progress[:, None] * (end_deg - start_deg)
    np.testing.assert_allclose(np.rad2deg(value[:, 3:]), expected, rtol=0.0, atol=1e-10)


AXES = {
    "x": [1.0, 0.0, 0.0],
    "y": [0.0, 1.0, 0.0],
    "z": [0.0, 0.0, 1.0],
    "-z": [0.0, 0.0, -1.0],
    "x - y": [1.0, -1.0, 0.0],
    "z - x": [-1.0, 0.0, 1.0],
}


@pytest.mark.parametrize("axis", AXES.values(), ids=AXES)
def test_half_a_turn_goes_both_ways_round_whatever_rounding_says(axis: list[float]) -> None:
    """The same two sets of paths from matrices that differ in their last digits."""
    unit = np.array(axis) / np.linalg.norm(axis)
    s, rng = np.linspace(0.0, 1.0, 11), np.random.default_rng(1)
    coefficients = rng.normal(scale=0.2, size=(6, 3))
    found = []
    for _ in range(20):
        start, end = (pin.exp3(rng.normal(scale=1e-14, size=3)) for _ in range(2))
        ways = end_effector_polynomials(
            at_rest(start), at_rest(end @ pin.exp3(np.pi * unit)), duration=10.0
        )
        assert len(ways) == 2
        turned = [way.pose(np.zeros((6, 3)), s)[1] for way in ways]
        for rotations in turned:
            angles = [np.linalg.norm(pin.log3(a.T @ b)) for a, b in pairwise(rotations)]
            assert sum(angles) == pytest.approx(np.pi, abs=1e-6)
        assert np.linalg.norm(pin.log3(turned[0][5].T @ turned[1][5])) == pytest.approx(np.pi)
        found.append([way.pose(coefficients, s)[1] for way in ways])
    np.testing.assert_allclose(found, [found[0]] * len(found), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("axis", AXES.values(), ids=AXES)
@pytest.mark.parametrize("angle_deg", [150.0, 179.0, 179.99])
def test_less_than_half_a_turn_goes_the_shorter_way_round(
    angle_deg: float, axis: list[float]
) -> None:
    unit, angle = np.array(axis) / np.linalg.norm(axis), np.deg2rad(angle_deg)
    start = rotation(0.0, 89.0, 0.0)  # where the paper's angles are not safe
    end = start @ pin.exp3(angle * unit)
    (way,) = end_effector_polynomials(at_rest(start), at_rest(end), duration=10.0)
    s = np.linspace(0.0, 1.0, 11)
    _, rotations = way.pose(np.zeros((6, 3)), s)
    share = 10 * s**3 - 15 * s**4 + 6 * s**5  # the quintic from rest to rest
    for found, part in zip(rotations, share, strict=True):
        expected = start @ pin.exp3(part * angle * unit)
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-7)


@pytest.mark.parametrize("seed", range(4))
def test_paths_towards_another_end_keep_their_start_and_meet_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    start, end, beside = (
        EndEffectorMotion(
            position=rng.normal(size=3),
            rotation_ee_to_inertial=pin.exp3(rng.normal(scale=0.5, size=3)),
            twist=rng.normal(size=6),
            acceleration=rng.normal(size=6),
        )
        for _ in range(3)
    )
    paths = end_effector_polynomial(start, end, 3.0)
    other = paths.towards(beside)
    assert other.reading == paths.reading
    coefficients, ends = rng.normal(scale=0.1, size=(6, 3)), np.array([0.0, 1.0])
    positions, rotations = other.pose(coefficients, ends)
    for i, wanted in enumerate((start, beside)):
        assert positions[i] == pytest.approx(wanted.position, abs=1e-10)
        assert rotations[i] == pytest.approx(wanted.rotation_ee_to_inertial, abs=1e-10)
        assert twist_of(other, coefficients, ends)[i] == pytest.approx(wanted.twist, abs=1e-9)
        found = acceleration_of(other, coefficients, ends)[i]
        assert found == pytest.approx(wanted.acceleration, abs=1e-8)


@pytest.mark.parametrize("seed", range(3))
def test_of_the_paths_through_a_place_it_is_the_nearest_to_the_straight_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    paths = end_effector_polynomial(*random_ends("inertial", seed), 10.0)
    place, s = rng.normal(size=3), rng.uniform(0.3, 0.9)
    found = paths.through(place, s)
    positions, _ = paths.pose(found, np.array([s]))
    assert positions[0] == pytest.approx(place, abs=1e-10)
    assert not found[3:].any()
    dense = np.linspace(0.0, 1.0, 2001)
    straight, _ = paths.pose(STRAIGHT, dense)

    def aside(coefficients: Array) -> float:
        return float(((paths.pose(coefficients, dense)[0] - straight) ** 2).mean())

    # Changes that leave it there: c0 + c1 s + c2 s^2 = 0.
    for change in (np.array([-s, 1.0, 0.0]), np.array([-(s**2), 0.0, 1.0])):
        for component in range(3):
            other = found.copy()
            other[component] += 0.05 * rng.choice([-1.0, 1.0]) * change
            assert paths.pose(other, np.array([s]))[0][0] == pytest.approx(place, abs=1e-10)
            assert aside(other) > aside(found)
