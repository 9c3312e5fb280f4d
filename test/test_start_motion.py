"""Any start that was measured: it is joined, carried in, or refused before any search."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from core_rows import sensitivity_of
from reference_end_effector import faded, twist_of
from robots import CANADARM2_SCENARIO, LEMUR_SCENARIO, ROBOTS, random_path, random_state
from shared_plans import planned

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.forward import driven
from ff_planner_ros.planning.motion.joint_motion import JointMotion, joint_motion
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.watch import Watch
from ff_planner_ros.planning.paths.end_effector_polynomial import EndEffectorPaths
from ff_planner_ros.planning.paths.start_motion import NullSpaceFade, start_motion
from ff_planner_ros.planning.problem.problem import Limits, Objective, PlanningProblem
from ff_planner_ros.planning.problem.settings import SearchDepth
from ff_planner_ros.planning.requirements.limits.joint_limits import JointPositions, JointRates
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.planning.task.tail import EndBehaviour
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.scenarios import scenario
from ff_planner_ros.robot.configuration import configuration, system_state
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.robot.momentum import generalised_jacobian, total_momentum
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.simulation.verification import verify

# What is tested here does not depend on how long the least attitude is looked for.
SETTINGS = replace(load_parameters().planner, search=SearchDepth.QUICK)
LENGTH, ATTITUDE = Objective(1.0, 0.0), Objective(0.0, 1.0)
RATE_JUMP, ACCELERATION_JUMP = 1e-9, 1e-6  # allowed [rad/s, rad/s2]
REDUNDANT = [name for name in ROBOTS if name != "six joints"]
DURATION = 5.0


class NeverSearches(Watch):
    """Fails where a search begins."""

    def require_time(self, *_: str) -> None:
        raise AssertionError("a search was begun")


def null_space(robot: Robot, state: SystemState) -> Array:
    """Directions of joint rates that move the end effector not at all, a column each."""
    q, _ = configuration(robot, state)
    _, _, rows = np.linalg.svd(generalised_jacobian(robot, robot.model.createData(), q))
    return rows[6:].T


def with_null_space_rates(
    problem: PlanningProblem, rng: np.random.Generator, largest: float
) -> PlanningProblem:
    """The same problem whose fastest joint has so much null-space motion [rad/s]."""
    directions = null_space(problem.robot, problem.start)
    added = directions @ rng.normal(size=directions.shape[1])
    added *= largest / np.abs(added).max()
    rates = problem.start.joint_velocities + added
    return replace(problem, start=replace(problem.start, joint_velocities=rates))


def problems() -> dict[str, PlanningProblem]:
    """The paper's arm, one of six joints, and Canadarm2."""
    return {
        "lemur": load_scenario(LEMUR_SCENARIO),
        "arm6": scenario("ordinary", "arm6", 3, turned=False).problem,
        "canadarm2": load_scenario(CANADARM2_SCENARIO),
    }


# What the start decides.


def test_without_null_space_motion_nothing_is_carried_in(lemur_capture: PlanningProblem) -> None:
    robot, start = lemur_capture.robot, lemur_capture.start
    found = start_motion(robot, start, 10.0)
    assert found.null_space is None
    assert np.array_equal(found.end_effector.acceleration, np.zeros(6))


@pytest.mark.parametrize("name", ROBOTS)
def test_the_end_effector_s_acceleration_is_that_of_a_system_that_nothing_pushes(
    name: str,
) -> None:
    """Against central differences of the end effector's twist, its joints driven by a parabola."""
    robot = robot_from_urdf_text(*ROBOTS[name])
    rng = np.random.default_rng(1)
    state = random_state(robot, rng)
    accelerations = rng.normal(scale=0.3, size=robot.joints)
    state = replace(state, joint_accelerations=accelerations)
    q, v = configuration(robot, state)
    data, tip, h = robot.model.createData(), robot.tip_frame_id, 1e-3
    momentum = total_momentum(robot, data, q, v)

    def twist_after(seconds: float) -> Array:
        time = np.array([0.0, seconds])
        rates = state.joint_velocities + np.outer(time, accelerations)
        way = np.outer(time, state.joint_velocities) + np.outer(time**2 / 2, accelerations)
        order = np.argsort(time)
        joints = JointMotion(
            time[order],
            (state.joint_positions + way)[order],
            rates[order],
            np.tile(accelerations, (2, 1)),
        )
        steps = np.linspace(0.0, seconds, 5)
        q_end, v_end = (rows[-1] for rows in driven(robot, q, momentum, joints, steps)[:2])
        pin.forwardKinematics(robot.model, data, q_end, v_end)
        pin.updateFramePlacement(robot.model, data, tip)
        twist = pin.getFrameVelocity(robot.model, data, tip, pin.LOCAL_WORLD_ALIGNED)
        return np.asarray(twist.vector)

    expected = (twist_after(h) - twist_after(-h)) / (2 * h)
    found = start_motion(robot, state, DURATION).end_effector.acceleration
    assert found == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())


def test_null_space_motion_fades_smoothly_from_what_it_was() -> None:
    fade = NullSpaceFade(np.array([0.2, -0.1]), np.array([0.03, 0.05]), 4.0)
    time, h = np.linspace(0.0, 5.0, 501), 1e-5
    values, slopes = faded(fade, time)
    assert values[0].tolist() == [0.2, -0.1]
    assert slopes[0].tolist() == [0.03, 0.05]
    assert np.abs(values[time >= 4.0]).max() < 1e-15
    assert np.abs(slopes[time >= 4.0]).max() < 1e-15
    inside = time[1:-1]
    differences = (faded(fade, inside + h)[0] - faded(fade, inside - h)[0]) / (2 * h)
    assert slopes[1:-1] == pytest.approx(differences, abs=1e-9)
    # The slope itself has no step or corner where fading begins to bite or ends.
    assert np.abs(np.diff(slopes, axis=0)).max() < 0.01 * np.abs(slopes).max() + 1e-3


# The family with null-space motion.


@pytest.fixture(params=REDUNDANT, scope="module")
def fading(request: pytest.FixtureRequest) -> tuple[EndEffectorPaths, Array]:
    """Paths of a robot whose start has null-space motion that changes, and one of them."""
    robot = robot_from_urdf_text(*ROBOTS[request.param])
    # Of what is drawn at random, what stays away from singularities.
    rng = np.random.default_rng(17)
    seed = {"lemur": 2, "canadarm2": 4}.get(request.param, 7)
    state = random_state(robot, np.random.default_rng(seed))
    q, v = configuration(robot, state)
    directions = null_space(robot, state)
    z, z_rate = (directions @ rng.normal(scale=0.1, size=directions.shape[1]) for _ in range(2))
    paths = EndEffectorPaths(
        robot,
        q,
        total_momentum(robot, robot.model.createData(), q, v),
        random_path(robot, state, rng, DURATION, reach=0.05),
        NullSpaceFade(z, z_rate, 0.5 * DURATION),
    )
    return paths, rng.normal(scale=0.05, size=18)


def test_sensitivities_with_null_space_motion_are_those_of_differences(
    fading: tuple[EndEffectorPaths, Array],
) -> None:
    paths, x = fading
    model, step = paths.robot.model, 1e-5
    sensitivity = sensitivity_of(paths, paths.motion(x, 9))
    differences_of_q, differences_of_v = [], []
    for aside in step * np.eye(len(x)):
        plus, minus = paths.motion(x + aside, 9), paths.motion(x - aside, 9)
        pairs = zip(minus.q, plus.q, strict=True)
        between = np.array([pin.difference(model, *pair) for pair in pairs])
        differences_of_q.append(between / (2 * step))
        differences_of_v.append((plus.v - minus.v) / (2 * step))
    for name, found, expected in (
        ("v", sensitivity.v, np.moveaxis(differences_of_v, 0, 2)),
        ("joints", sensitivity.q[:, 6:], np.moveaxis(differences_of_q, 0, 2)[:, 6:]),
    ):
        error = np.abs(found - expected).max() / np.abs(expected).max()
        assert error < 1e-7, f"{name}: relative error {error:.1e}"


def test_accelerations_with_null_space_motion_are_those_of_the_velocities(
    fading: tuple[EndEffectorPaths, Array],
) -> None:
    """Along a rollout so fine that its own differences are exact to the wanted digits."""
    paths, x = fading
    points = 2001
    motion = paths.motion(x, points)
    found = sensitivity_of(paths, motion).acceleration
    h = DURATION / (points - 1)
    v = motion.v
    differences = (8 * (v[3:-1] - v[1:-3]) - (v[4:] - v[:-4])) / (12 * h)
    # Where fading ends the third derivative of z has a step, which differences do not see through.
    smooth = np.abs(np.linspace(0.0, 1.0, points)[2:-2] - 0.5) > 4 / points
    error = np.abs(found[2:-2] - differences)[smooth].max() / np.abs(differences).max()
    assert error < 1e-7, f"relative error {error:.1e}"


def test_momentum_and_the_end_effector_s_way_do_not_depend_on_null_space_motion(
    fading: tuple[EndEffectorPaths, Array],
) -> None:
    paths, x = fading
    model, data, tip = paths.robot.model, paths.robot.model.createData(), paths.robot.tip_frame_id
    motion = paths.motion(x, 21)
    plain = replace(paths, null_space=None).motion(x, 21)
    wanted = twist_of(paths.polynomial, x.reshape(6, 3), np.linspace(0.0, 1.0, 21))
    assert np.abs(motion.v[0, 6:] - plain.v[0, 6:]).max() > 0.02
    for point, (q, v) in enumerate(zip(motion.q, motion.v, strict=True)):
        momentum = total_momentum(paths.robot, data, q, v)
        assert momentum == pytest.approx(paths.momentum, rel=1e-9, abs=1e-9), point
        pin.forwardKinematics(model, data, q, v)
        pin.updateFramePlacement(model, data, tip)
        twist = pin.getFrameVelocity(model, data, tip, pin.LOCAL_WORLD_ALIGNED).vector
        np.testing.assert_allclose(twist, wanted[point], rtol=0.0, atol=1e-10)


# Plans.


@pytest.mark.sampled
@pytest.mark.law("PLAN-01")
@pytest.mark.parametrize(
    "objective",
    [
        pytest.param(LENGTH, id="length"),
        pytest.param(ATTITUDE, id="attitude", marks=pytest.mark.ci),
    ],
)
@pytest.mark.parametrize("points", [50, 9])
@pytest.mark.parametrize("name", ["lemur", "arm6", "canadarm2"])
def test_a_plan_made_in_the_middle_of_another_joins_it(
    name: str, points: int, objective: Objective, times: Callable[[int, int], int]
) -> None:
    """At any time, its last second and its tail included."""
    problem = problems()[name]
    # Canadarm2 takes its time, and so coarse a quintic would miss its goal.
    points = points if name != "canadarm2" else max(points, 25)
    seconds = 2.0
    task = PlanningTask(
        replace(problem, points=points),
        SETTINGS,
        end_behaviour=EndBehaviour.STOP_JOINTS,
        tail=seconds,
    )
    first = perform(task)
    running, end = joint_motion(first.trajectory), problem.duration
    rng = np.random.default_rng(points)
    moments = [
        *rng.uniform(0.0, end, times(1, 12)),
        *rng.uniform(end - 1.0, end, times(1, 6)),
        *rng.uniform(end, end + seconds, times(1, 6)),
    ]
    for moment in moments:
        asked = replace(task, problem=replace(problem, objective=objective), ahead=float(moment))
        begins = perform(replace(asked, running=running)).trajectory
        _, (rates,), (accelerations,) = running.at(np.array([moment]))
        jump = np.abs(begins.joint_velocities[0] - rates).max()
        assert jump <= RATE_JUMP, f"rates at {moment:.3f} s"
        jump = np.abs(begins.joint_accelerations[0] - accelerations).max()
        assert jump <= ACCELERATION_JUMP, f"accelerations at {moment:.3f} s"


def test_a_plan_made_where_another_is_measured_joins_it(lemur_capture: PlanningProblem) -> None:
    """The state is stamped with the plan's first point: nothing is carried forward."""
    first = perform(PlanningTask(lemur_capture, SETTINGS)).trajectory
    q, v = (rows[20] for rows in from_trajectory(lemur_capture.robot, first))
    start = system_state(lemur_capture.robot, q, v)
    running = joint_motion(first, start=-float(first.time[20]))
    for task in (
        PlanningTask(replace(lemur_capture, start=start), SETTINGS, running=running),
        PlanningTask(
            replace(
                lemur_capture,
                start=replace(start, joint_accelerations=first.joint_accelerations[20]),
            ),
            SETTINGS,
        ),
    ):
        begins = perform(task).trajectory
        assert np.abs(begins.joint_velocities[0] - v[6:]).max() <= RATE_JUMP
        jump = np.abs(begins.joint_accelerations[0] - first.joint_accelerations[20]).max()
        assert jump <= ACCELERATION_JUMP


def redundant_problems() -> dict[str, tuple[PlanningProblem, float]]:
    """Problems without obstacles, and the null-space rate of the fastest joint [rad/s]."""
    lemur, arm7 = (scenario("ordinary", arm, 2, turned=False).problem for arm in ("lemur", "arm7"))
    canadarm2 = replace(load_scenario(CANADARM2_SCENARIO), limits=Limits(True))
    return {
        "lemur": (replace(lemur, obstacles=()), 0.25),
        "arm7": (replace(arm7, obstacles=()), 0.15),
        "canadarm2": (canadarm2, 0.05),
    }


@pytest.mark.parametrize("name", ["lemur", "arm7", "canadarm2"])
def test_null_space_motion_of_the_start_is_carried_in_and_the_plan_comes_true(
    name: str, times: Callable[[int, int], int]
) -> None:
    problem, largest = redundant_problems()[name]
    for seed in range(times(1, 8)):
        asked = with_null_space_rates(problem, np.random.default_rng(seed), largest)
        found = perform(PlanningTask(asked, SETTINGS))
        jump = found.trajectory.joint_velocities[0] - asked.start.joint_velocities
        assert np.abs(jump).max() <= RATE_JUMP, f"seed {seed}"
        assert found.metrics.start_velocity_jump <= RATE_JUMP
        assert found.metrics.momentum_error < 1e-6
        executed = verify(asked.robot, found.trajectory)
        assert executed.passed, f"seed {seed}: {executed.deviation}"


def test_a_start_without_null_space_motion_plans_as_if_there_were_none_to_the_last_bit(
    lemur_capture: PlanningProblem,
) -> None:
    """What rounding leaves of it in the start's rates is not carried in."""
    directions = null_space(lemur_capture.robot, lemur_capture.start)
    rounded = lemur_capture.start.joint_velocities + 1e-13 * directions[:, 0]
    start = replace(lemur_capture.start, joint_velocities=rounded)
    assert start_motion(lemur_capture.robot, start, 10.0).null_space is None


# What the start alone decides.


def at_limit(problem: PlanningProblem, rate: float, acceleration: float | None) -> PlanningProblem:
    """The third joint at its upper limit, with a rate and an acceleration, known or not."""
    robot, start = problem.robot, problem.start
    upper = robot.upper_position_limits.copy()
    upper[2] = start.joint_positions[2]
    rates, accelerations = start.joint_velocities.copy(), np.zeros(robot.joints)
    rates[2], accelerations[2] = rate, acceleration or 0.0
    return replace(
        problem,
        robot=replace(robot, upper_position_limits=upper),
        start=replace(
            start,
            joint_velocities=rates,
            joint_accelerations=None if acceleration is None else accelerations,
        ),
    )


def at_full_speed(problem: PlanningProblem, acceleration: float) -> PlanningProblem:
    """The third joint at its rate limit, accelerating; all null-space motion is welcome."""
    rates, accelerations = problem.start.joint_velocities.copy(), np.zeros(problem.robot.joints)
    rates[2], accelerations[2] = -problem.robot.velocity_limits[2], acceleration
    start = replace(problem.start, joint_velocities=rates, joint_accelerations=accelerations)
    return replace(problem, start=start, limits=Limits(joint_velocities=True))


def too_strong(problem: PlanningProblem) -> PlanningProblem:
    accelerations = np.full(problem.robot.joints, 4.0)
    return replace(problem, start=replace(problem.start, joint_accelerations=accelerations))


IMPOSSIBLE: dict[str, tuple[Callable[[PlanningProblem], PlanningProblem], str]] = {
    "moves outward at its limit": (
        lambda problem: at_limit(problem, 0.01, None),
        r"joints\.velocity\[joint_3\] is 0\.010000 rad/s at .* whatever a plan does",
    ),
    "moves outward at its limit, hardly slower and slower": (
        lambda problem: at_limit(problem, 0.01, -0.05),
        r"joints\.velocity\[joint_3\]",
    ),
    "at its limit, begins to move outward": (
        lambda problem: at_limit(problem, 0.0, 0.5),
        r"joints\.velocity\[joint_3\]",
    ),
    "faster and faster at its rate limit": (
        lambda problem: at_full_speed(problem, -0.1),
        r"joints\.acceleration\[joint_3\] is -0\.1.*rad/s2 .* whatever a plan does",
    ),
    "beyond its effort limit": (
        too_strong,
        r"joints\.acceleration is \[.*joint_\d needs .* beyond its effort limit",
    ),
}


@pytest.mark.law("PLAN-29")
@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_what_the_start_alone_decides_is_refused_before_any_search(
    lemur_capture: PlanningProblem, name: str
) -> None:
    spoil, words = IMPOSSIBLE[name]
    with pytest.raises(InvalidInput, match=words) as refusal:
        plan(spoil(lemur_capture), SETTINGS, NeverSearches())
    assert refusal.value.status is Status.START_OUTSIDE_LIMITS


@pytest.mark.parametrize("acceleration", [None, 0.05])
def test_a_joint_that_leaves_its_limit_is_not_refused(
    lemur_capture: PlanningProblem, acceleration: float | None
) -> None:
    problem = at_limit(lemur_capture, -0.05, acceleration)
    with pytest.raises(AssertionError, match="a search was begun"):
        plan(problem, SETTINGS, NeverSearches())


def test_a_joint_at_its_rate_limit_that_slows_down_is_not_refused(
    lemur_capture: PlanningProblem,
) -> None:
    with pytest.raises(AssertionError, match="a search was begun"):
        plan(at_full_speed(lemur_capture, 0.1), SETTINGS, NeverSearches())


def test_a_joint_that_a_motion_turns_at_its_limit_is_never_refused_along_it(
    lemur_capture: PlanningProblem,
) -> None:
    """The limit is where the third joint of a plan turns round: its own plan keeps it."""
    motion = joint_motion(planned(lemur_capture, SETTINGS).trajectory)
    time = np.linspace(0.0, 10.0, 20_001)
    positions, rates, accelerations = motion.at(time)
    robot, start = lemur_capture.robot, lemur_capture.start

    def turns(values: Array) -> Array:
        """The highest value of each joint where it is between the ends, else anything."""
        at_end = np.isin(values.argmax(axis=0), [0, len(time) - 1])
        return np.where(at_end, 9.0, values.max(axis=0))

    robot = replace(
        robot,
        upper_position_limits=turns(positions),
        lower_position_limits=-turns(-positions),
        velocity_limits=turns(np.abs(rates)),
    )
    problem = replace(lemur_capture, robot=robot, limits=Limits(joint_velocities=True))
    extremes = [(+positions).argmax(axis=0), (-positions).argmax(axis=0), abs(rates).argmax(axis=0)]
    beside = np.array([-200, -20, -2, 0, 2, 20, 200])
    assert np.isin(np.concatenate(extremes), [0, len(time) - 1]).mean() < 0.9
    for moment in np.unique(np.clip(np.add.outer(extremes, beside), 0, len(time) - 1)):
        there = replace(
            start,
            joint_positions=positions[moment],
            joint_velocities=rates[moment],
            joint_accelerations=accelerations[moment],
        )
        for required in (JointPositions(), JointRates()):
            asked = replace(problem, start=there)
            required.refuse_start(asked, configuration(robot, there)[0], SETTINGS)
