"""A body that nothing acts on: its motion against textbooks, conservation laws and MuJoCo."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import ellipj

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.planning.problem.obstacles import attached
from ff_planner_ros.planning.problem.target_body import AttachedObstacle, TargetBody
from ff_planner_ros.robot.collision.solids import Solid

DEG = np.pi / 180.0
ASYMMETRIC = np.array([1.0, 1.7, 2.3])
# About the intermediate axis, but for a push that makes it turn over.
INTERMEDIATE = np.array([1e-3, 10.0, 1e-3]) * DEG


def body(moments: Array, rate_in_body: Array, axes: Rotation | None = None) -> TargetBody:
    """Return a body somewhere; `axes` are those of its inertia in its own."""
    attitude = Rotation.from_euler("xyz", [0.3, -0.8, 1.9])
    to_body = (axes or Rotation.identity()).as_matrix()
    return TargetBody(
        position=[1.0, -2.0, 0.5],
        quaternion_xyzw=attitude.as_quat(),
        inertia=to_body @ np.diag(moments) @ to_body.T,
        grasp_position=[0.4, 0.3, -0.2],
        grasp_quaternion_xyzw=Rotation.from_euler("xyz", [0.1, 0.2, 0.3]).as_quat(),
        linear_velocity=[0.01, -0.02, 0.03],
        angular_velocity=attitude.as_matrix() @ to_body @ rate_in_body,
    )


def drawn_body(rng: np.random.Generator) -> TargetBody:
    """Draw a body: its moments are sums of two positive numbers each, as bodies' are."""
    a, b, c = rng.uniform(0.05, 1.0, 3)
    axes = Rotation.random(rng=rng)
    rate = rng.uniform(1.0, 10.0) * DEG * Rotation.random(rng=rng).apply([1.0, 0.0, 0.0])
    return body(np.array([b + c, a + c, a + b]), rate, axes)


@pytest.mark.parametrize(
    ("moments", "rate"),
    [
        (np.array([1.0, 1.0, 1.0]), np.array([5.0, -3.0, 2.0]) * DEG),
        (np.array([1.0, 1.0, 1.8]), np.array([4.0, 1.0, 8.0]) * DEG),
        (ASYMMETRIC, np.array([5.0, 2.0, -4.0]) * DEG),
        (ASYMMETRIC, INTERMEDIATE),
        (np.array([0.02, 1.0, 1.01]), np.array([1.0, 9.0, 5.0]) * DEG),
        (np.array([1.0, 1.0, 2.0]), np.array([0.0, 0.0, 0.0])),
    ],
    ids=["ball", "disc", "asymmetric", "intermediate axis", "rod", "at rest"],
)
def test_angular_momentum_and_energy_stay_over_ten_minutes(moments: Array, rate: Array) -> None:
    """But for rounding: a series is used as far as its last terms are no more than that."""
    moving = body(moments, rate, Rotation.from_euler("xyz", [0.5, 0.4, -1.0]))
    motion = moving.motion(np.zeros(3), np.linspace(0.0, 600.0, 2001))
    to_inertial, rates = motion.rotations, motion.twists[:, 3:]
    inertias = to_inertial @ moving.inertia @ to_inertial.swapaxes(1, 2)
    momenta = np.einsum("tij,tj->ti", inertias, rates)
    energies = np.einsum("ti,ti->t", momenta, rates) / 2.0
    assert np.abs(momenta - momenta[0]).max() <= 1e-12 * np.linalg.norm(momenta[0])
    assert np.abs(energies - energies[0]).max() <= 1e-12 * energies[0]
    products = to_inertial @ to_inertial.swapaxes(1, 2)
    assert np.abs(products - np.eye(3)).max() < 1e-13
    if rate is INTERMEDIATE:  # it does turn over
        along = np.einsum("ti,ti->t", to_inertial[:, :, 1], to_inertial[0, :, 1][None])
        assert along.min() < 0.0


def test_a_symmetric_top_precesses_as_in_the_textbook() -> None:
    """With moments A, A, C: about L at L / A, and about its own axis at (A - C) / A w_z."""
    a, c = 1.0, 1.8
    rate = np.array([4.0, 1.0, 8.0]) * DEG
    moving = body(np.array([a, a, c]), rate)
    times = np.linspace(0.0, 600.0, 601)
    first = Rotation.from_quat(moving.quaternion_xyzw)
    momentum = first.apply(np.array([a, a, c]) * rate)
    precession = Rotation.from_rotvec(np.outer(times, momentum / a))
    spin = Rotation.from_rotvec(np.outer(times, [0.0, 0.0, (a - c) / a * rate[2]]))
    expected = (precession * first * spin).as_matrix()
    found = moving.motion(np.zeros(3), times).rotations
    assert np.abs(found - expected).max() < 1e-10


@pytest.mark.law("PLAN-14")
@pytest.mark.parametrize("case", ["about the largest", "about the smallest"])
def test_an_asymmetric_body_turns_as_jacobis_elliptic_functions(case: str) -> None:
    """Landau and Lifshitz, Mechanics, Sec. 37, with I1 < I2 < I3 and w2 = 0 at time zero."""
    one, two, three = ASYMMETRIC
    rate = np.array([3.0, 0.0, 6.0] if case == "about the largest" else [6.0, 0.0, 1.0]) * DEG
    energy2, momentum2 = ASYMMETRIC @ rate**2, (ASYMMETRIC**2) @ rate**2
    largest = momentum2 > energy2 * two
    assert largest == (case == "about the largest")
    above, below = energy2 * three - momentum2, momentum2 - energy2 * one
    if largest:
        pace = np.sqrt((three - two) * (momentum2 - energy2 * one) / (one * two * three))
        modulus = (two - one) * above / ((three - two) * below)
    else:
        pace = np.sqrt((two - one) * above / (one * two * three))
        modulus = (three - two) * below / ((two - one) * above)
    times = np.linspace(0.0, 600.0, 401)
    sn, cn, dn, _ = ellipj(pace * times, modulus)
    first, third = (cn, dn) if largest else (dn, cn)
    second = np.sqrt(above / (two * (three - two)) if largest else below / (two * (two - one)))
    expected = np.column_stack([rate[0] * first, second * sn, rate[2] * third])
    moving = body(ASYMMETRIC, rate)
    motion = moving.motion(np.zeros(3), times)
    found = np.einsum("tji,tj->ti", motion.rotations, motion.twists[:, 3:])
    assert np.abs(found - expected).max() < 1e-10 * np.linalg.norm(rate) * 600.0


def test_mujoco_moves_the_body_the_same_way() -> None:
    moving = drawn_body(np.random.default_rng(3))
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><option gravity="0 0 0" timestep="0.01" integrator="RK4"/><worldbody><body>'
        "<freejoint/><inertial pos='0 0 0' mass='1' fullinertia='{}'/></body></worldbody>"
        "</mujoco>".format(" ".join(str(moving.inertia[i, j]) for i, j in _ORDER_OF_MUJOCO))
    )
    data = mujoco.MjData(model)
    to_inertial = Rotation.from_quat(moving.quaternion_xyzw)
    data.qpos[:3], data.qpos[3:] = moving.position, np.roll(moving.quaternion_xyzw, 1)
    data.qvel[:3] = moving.linear_velocity
    data.qvel[3:] = to_inertial.as_matrix().T @ moving.angular_velocity
    seconds = 60.0
    mujoco.mj_step(model, data, round(seconds / model.opt.timestep))
    motion = moving.motion(np.zeros(3), np.array([seconds]))
    assert np.abs(data.qpos[:3] - motion.positions[0]).max() < 1e-9
    found = Rotation.from_quat(np.roll(data.qpos[3:], -1)).as_matrix()
    assert np.abs(found - motion.rotations[0]).max() < 1e-7
    assert np.abs(motion.rotations[0] @ data.qvel[3:] - motion.twists[0, 3:]).max() < 1e-8


_ORDER_OF_MUJOCO = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]


@pytest.mark.parametrize("seed", range(4))
def test_twist_acceleration_and_jerk_are_derivatives_of_the_pose(seed: int) -> None:
    rng = np.random.default_rng(seed)
    moving, h = drawn_body(rng), 1e-3
    time, point = rng.uniform(1.0, 500.0), rng.normal(size=3)
    motion = moving.motion(point, np.array([time - h, time, time + h]))
    before, after = Rotation.from_matrix(motion.rotations[::2])
    by_differences = np.concatenate(
        [
            (motion.positions[2] - motion.positions[0]) / (2 * h),
            (after * before.inv()).as_rotvec() / (2 * h),
        ]
    )
    assert motion.twists[1] == pytest.approx(by_differences, abs=1e-8)
    for rows, derivatives in (
        (motion.twists, motion.accelerations),
        (motion.accelerations, motion.jerks),
    ):
        assert derivatives[1] == pytest.approx((rows[2] - rows[0]) / (2 * h), abs=1e-8)


def test_the_grasp_is_at_rest_in_the_body() -> None:
    moving = drawn_body(np.random.default_rng(8))
    times = np.linspace(0.0, 40.0, 9)
    motion, grasp = moving.motion(np.zeros(3), times), moving.grasp(times)
    in_body = np.einsum("tji,tj->ti", motion.rotations, grasp.positions - motion.positions)
    assert in_body == pytest.approx(np.tile(moving.grasp_position, (9, 1)), abs=1e-12)
    turned = motion.rotations.swapaxes(1, 2) @ grasp.rotations
    wanted = Rotation.from_quat(moving.grasp_quaternion_xyzw).as_matrix()
    assert turned == pytest.approx(np.tile(wanted, (9, 1, 1)), abs=1e-12)
    assert moving.places(moving.grasp_position[None], times)[:, 0] == pytest.approx(
        grasp.positions, abs=1e-12
    )
    target = moving.target(40.0)
    assert target.position == pytest.approx(grasp.positions[-1])
    assert target.linear_velocity == pytest.approx(grasp.twists[-1, :3])
    assert target.angular_acceleration == pytest.approx(grasp.accelerations[-1, 3:])


def test_the_motion_is_the_same_in_every_inertial_frame() -> None:
    """Turned, 7000 km away and at 8 km/s, up to what these leave of double precision."""
    rng = np.random.default_rng(5)
    moving, turn = drawn_body(rng), Rotation.random(rng=rng)
    away, fast = np.array([7e6, -1e6, 2e6]), np.array([8e3, 1e3, -2e3])
    seen = replace(
        moving,
        position=turn.apply(+moving.position) + away,
        quaternion_xyzw=(turn * Rotation.from_quat(moving.quaternion_xyzw)).as_quat(),
        linear_velocity=turn.apply(+moving.linear_velocity) + fast,
        angular_velocity=turn.apply(+moving.angular_velocity),
    )
    times = np.linspace(0.0, 600.0, 7)
    grasp, there = moving.grasp(times), seen.grasp(times)
    axes = turn.as_matrix()
    back = there.positions - away - np.outer(times, fast)
    assert np.abs(back - turn.apply(+grasp.positions)).max() < 1e-8
    assert np.abs(there.rotations - axes @ grasp.rotations).max() < 1e-9
    both = np.kron(np.eye(2), axes)
    assert np.abs(there.accelerations - grasp.accelerations @ both.T).max() < 1e-9
    assert np.abs(there.jerks - grasp.jerks @ both.T).max() < 1e-9


@pytest.mark.parametrize("seed", range(3))
def test_what_is_asked_of_the_end_effector_is_the_motion_of_the_grasp(seed: int) -> None:
    """Its accelerations are differences of the velocities, which are differences of the places."""
    moving, aside, time = drawn_body(np.random.default_rng(300 + seed)), 1e-3, 20.0
    before, target, after = (moving.target(time + way) for way in (-aside, 0.0, aside))
    for rate, of in (
        ("linear_velocity", "position"),
        ("linear_acceleration", "linear_velocity"),
        ("angular_acceleration", "angular_velocity"),
    ):
        expected = (getattr(after, of) - getattr(before, of)) / (2.0 * aside)
        assert np.linalg.norm(expected) > 1e-6, rate
        np.testing.assert_allclose(getattr(target, rate), expected, rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_the_fastest_turn_is_reached_and_never_exceeded(seed: int) -> None:
    moving = drawn_body(np.random.default_rng(100 + seed))
    rates = moving.motion(np.zeros(3), np.linspace(0.0, 2000.0, 20_000)).twists[:, 3:]
    largest = np.linalg.norm(rates, axis=1).max()
    assert largest <= moving.fastest_turn * (1.0 + 1e-9)
    assert largest == pytest.approx(moving.fastest_turn, rel=1e-3)


def test_what_was_asked_before_does_not_change_what_is_answered() -> None:
    one = drawn_body(np.random.default_rng(11))
    other = replace(one)
    times = np.linspace(0.0, 300.0, 50)
    for time in (10.0, 3.0, 150.0):
        one.target(time)
    assert (one.grasp(times).positions == other.grasp(times).positions).all()


def test_only_ratios_of_the_inertia_matter() -> None:
    moving = drawn_body(np.random.default_rng(12))
    for factor in (1e-150, 3.7, 1e99):
        scaled = replace(moving, inertia=factor * moving.inertia)
        assert scaled.target(100.0).position == pytest.approx(moving.target(100.0).position)
        assert scaled.fastest_turn == pytest.approx(moving.fastest_turn)


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("inertia", np.zeros((3, 3)), "positive"),
        ("inertia", np.diag([1.0, 1.0, 2.1]), "sum of the others"),
        ("inertia", np.diag([1.0, -1.0, 1.0]), "positive"),
        ("inertia", np.diag([0.0, 1.0, 1.0]), "positive"),
        ("inertia", np.array([[1.0, 0.1, 0], [0, 1.0, 0], [0, 0, 1.0]]), "symmetric"),
        ("inertia", np.diag([1.0, 1.0, np.nan]), "finite"),
        ("inertia", np.array([[1.0, 0.9, 0], [0.9, 1.0, 0.9], [0, 0.9, 1.0]]), "positive"),
        ("position", [0.0, np.inf, 0.0], "finite"),
        ("angular_velocity", [0.0, 1.0], "3 entries"),
        ("grasp.quaternion_xyzw", [0.0, 0.0, 0.0, 2.0], "norm"),
        ("grasp.position", [np.nan, 0.0, 0.0], "finite"),
    ],
)
def test_what_no_body_has_is_refused_by_name(field: str, value: object, words: str) -> None:
    moving = drawn_body(np.random.default_rng(1))
    with pytest.raises(InvalidInput, match=words) as refused:
        replace(moving, **{field.replace(".", "_"): value})
    assert refused.value.field == f"target_body.{field}"


def test_a_grasp_inside_an_attached_sphere_is_refused() -> None:
    moving = drawn_body(np.random.default_rng(1))
    sphere = AttachedObstacle.sphere(
        "tank", moving.grasp_position + np.array([0.1, 0.0, 0.0]), 0.11
    )
    with pytest.raises(InvalidInput, match=r"grasp\.position.*0\.01 m inside tank"):
        replace(moving, obstacles=(sphere,))
    replace(moving, obstacles=(replace(sphere, shape=Solid("sphere", [0.09])),))
    with pytest.raises(InvalidInput, match="unique"):
        replace(moving, obstacles=2 * (replace(sphere, shape=Solid("sphere", [0.09])),))
    with pytest.raises(InvalidInput, match=r"target_body\.obstacles\[tank\]\.radius"):
        AttachedObstacle.sphere("tank", sphere.position, 0.0)


def test_a_flat_plate_is_a_body_and_so_is_a_rod_of_some_thickness() -> None:
    for moments in ([1.0, 1.0, 2.0], [1e-5, 1.0, 1.0]):
        body(np.array(moments), np.array([0.1, 0.1, 0.1])).target(10.0)


def test_a_body_that_turns_too_far_is_refused_by_name() -> None:
    moving = body(ASYMMETRIC, np.array([1e6, 1e6, 0.0]))
    for ask in (moving.target, lambda time: moving.places(np.zeros((1, 3)), np.array([time]))):
        with pytest.raises(InvalidInput, match="too far") as refused:
            ask(10.0)
        assert refused.value.field == "target_body.angular_velocity"


@pytest.mark.parametrize("rate", [0.0, 5e-324, 1e-300, 1e-101, 1e-100])
def test_a_body_that_hardly_turns_is_foretold_at_once_however_far(rate: float) -> None:
    """A request for a capture after 1e30 s once held up the node for ever."""
    resting = body(ASYMMETRIC, np.array([0.0, rate, 0.0]))
    later = resting.after(1e100)
    assert later.position == pytest.approx(resting.position + 1e100 * resting.linear_velocity)
    turned = Rotation.from_quat(resting.quaternion_xyzw).inv() * Rotation.from_quat(
        later.quaternion_xyzw
    )
    expected = Rotation.from_rotvec([0.0, 1e100 * rate, 0.0])
    assert (turned * expected.inv()).magnitude() == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("time", [0.7, 12.0])
@pytest.mark.parametrize("seed", range(3))
def test_what_is_fixed_to_it_goes_on_as_what_is_fixed_to_it_later(seed: int, time: float) -> None:
    """Place, attitude and twist of each obstacle, by themselves and by the body."""
    rng = np.random.default_rng(seed)
    turn = Rotation.random(rng=rng).as_quat()
    box = AttachedObstacle("box", Solid("box", np.array([0.1, 0.2, 0.3])), rng.normal(size=3), turn)
    ball = AttachedObstacle.sphere("ball", [2.0, 0.3, -0.4], 0.1)
    tumbling = replace(drawn_body(rng), obstacles=(box, ball))
    for now, later in zip(attached(tumbling), attached(tumbling.after(time)), strict=True):
        found = now.after(time)
        assert found.motion.velocity == pytest.approx(later.motion.velocity, abs=1e-9)
        if not found.is_sphere and not later.is_sphere:
            assert found.motion.position == pytest.approx(later.motion.position, abs=1e-9)
            assert found.motion.angular_velocity == pytest.approx(
                later.motion.angular_velocity, abs=1e-9
            )
            turned = (Rotation.from_quat(one.motion.quaternion_xyzw) for one in (found, later))
            assert (next(turned).inv() * next(turned)).magnitude() < 1e-9
        elif found.is_sphere and later.is_sphere:
            assert found.center == pytest.approx(later.center, abs=1e-9)
