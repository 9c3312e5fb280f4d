"""The paper's capture, planned: reference values, determinism, refusals."""

import re
from dataclasses import replace
from itertools import count

import numpy as np
import pinocchio as pin
import pytest
from dense_motion import joints_between

from ff_planner_ros.common.share import share_directory
from ff_planner_ros.errors import EndedBy, InvalidInput, NoPlanFound, OutOfTime, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.check.preconditions import require_plannable
from ff_planner_ros.planning.motion.watch import CHECKING, REFINING, SEARCHING, Progress, Watch
from ff_planner_ros.planning.optimisation import solver
from ff_planner_ros.planning.optimisation.solver import Stop
from ff_planner_ros.planning.paths.joint_spline import joint_splines
from ff_planner_ros.planning.paths.path_family import Motion
from ff_planner_ros.planning.paths.start_motion import start_motion
from ff_planner_ros.planning.problem.problem import (
    DurationRange,
    Limits,
    Objective,
    Obstacle,
    Parametrisation,
)
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.search import guided_search, multi_start, planner
from ff_planner_ros.planning.search.families import path_families
from ff_planner_ros.planning.search.grid_solver import GridSolver
from ff_planner_ros.planning.search.guided_search import Allowance
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.robot.state import SystemState

CONFIG = share_directory() / "config"
LENGTH, ATTITUDE = Objective(1.0, 0.0), Objective(0.0, 1.0)
PAPERS = Parametrisation.END_EFFECTOR_POLYNOMIAL


@pytest.fixture(scope="module")
def settings():
    return load_parameters().planner


@pytest.fixture(scope="module")
def capture():
    return load_scenario(CONFIG / "scenarios" / "lemur_capture.yaml")


@pytest.fixture(scope="module")
def shortest(capture, settings):
    return plan(replace(capture, objective=LENGTH), settings)


def turned(problem, rotation, shift):
    """The same physics, seen from another inertial frame."""
    start, target = problem.start, problem.target

    def orientation(quaternion_xyzw):
        return pin.Quaternion(
            rotation @ pin.Quaternion(quaternion_xyzw).toRotationMatrix()
        ).coeffs()

    return replace(
        problem,
        start=replace(
            start,
            position_chaser_in_inertial=rotation @ start.position_chaser_in_inertial + shift,
            quaternion_chaser_to_inertial_xyzw=orientation(
                start.quaternion_chaser_to_inertial_xyzw
            ),
            linear_velocity_chaser_in_inertial=rotation @ start.linear_velocity_chaser_in_inertial,
            angular_velocity_chaser_in_inertial=rotation
            @ start.angular_velocity_chaser_in_inertial,
        ),
        target=replace(
            target,
            position=rotation @ target.position + shift,
            quaternion_xyzw=orientation(target.quaternion_xyzw),
        ),
        obstacles=tuple(
            sphere.with_motion(position=rotation @ sphere.center + shift)
            for sphere in problem.obstacles
        ),
    )


def test_the_shortest_plan_beats_the_reference_and_touches_nothing(shortest):
    """The reference is the best that an independent implementation found, with its slack."""
    metrics = shortest.metrics
    assert metrics.joint_path_length <= 1.115
    assert metrics.min_clearance >= 0.0
    assert metrics.penalty == 0.0
    assert metrics.min_joint_margin > 0.0
    assert shortest.solver.stop_reason.startswith("good enough")
    assert shortest.solver.starts == 1


@pytest.mark.ci
def test_the_plan_with_least_attitude_beats_the_reference_and_touches_nothing(capture, settings):
    metrics = plan(replace(capture, objective=ATTITUDE), settings).metrics
    assert np.rad2deg(metrics.max_chaser_euler) <= 6.0
    assert metrics.min_clearance >= 0.0
    assert metrics.penalty == 0.0


@pytest.mark.ci
def test_a_weighted_plan_turns_the_chaser_less_than_the_shortest(capture, settings, shortest):
    weighted = plan(replace(capture, objective=Objective(0.2, 0.8)), settings).metrics
    assert weighted.max_chaser_euler < shortest.metrics.max_chaser_euler
    assert weighted.joint_path_length > shortest.metrics.joint_path_length


@pytest.mark.law("PLAN-23")
def test_the_same_problem_gives_the_same_plan_to_the_last_bit(capture, settings, shortest):
    again = plan(replace(capture, objective=LENGTH), settings)
    assert (
        again.trajectory.joint_positions.tobytes() == shortest.trajectory.joint_positions.tobytes()
    )
    assert again.xi.tobytes() == shortest.xi.tobytes()
    assert again.metrics == shortest.metrics


@pytest.mark.law("PLAN-01")
def test_the_plan_starts_at_the_start_and_ends_at_the_target(capture, shortest):
    motion, target = shortest.trajectory, capture.target
    assert motion.time[[0, -1]].tolist() == [0.0, 10.0]
    assert motion.joint_positions[0] == pytest.approx(capture.start.joint_positions, abs=1e-12)
    assert motion.joint_velocities[0] == pytest.approx(capture.start.joint_velocities, abs=1e-12)
    assert motion.ee_positions[-1] == pytest.approx(target.position, abs=1e-5)
    assert abs(motion.ee_quaternions_xyzw[-1] @ target.quaternion_xyzw) == pytest.approx(1.0)
    assert motion.ee_linear_velocities[-1] == pytest.approx(np.zeros(3), abs=1e-12)


@pytest.mark.law("PLAN-02")
def test_a_tangent_capture_ends_with_the_wanted_twist(capture, settings):
    target = replace(
        capture.target,
        linear_velocity=np.array([0.02, 0.0, 0.03]),
        angular_velocity=np.array([0.0, 0.02, -0.01]),
    )
    problem = replace(capture, objective=LENGTH, target=target, parametrisation=PAPERS)
    motion = plan(problem, settings).trajectory
    assert motion.ee_linear_velocities[-1] == pytest.approx(target.linear_velocity, abs=1e-10)
    assert motion.ee_angular_velocities[-1] == pytest.approx(target.angular_velocity, abs=1e-10)


def test_a_free_scene_is_planned_and_has_no_clearance_to_speak_of(capture, settings):
    metrics = plan(replace(capture, objective=LENGTH, obstacles=()), settings).metrics
    assert metrics.min_clearance == np.inf
    assert metrics.penalty == 0.0
    assert metrics.joint_path_length < 1.107  # nothing in the way: shorter than the capture


def test_a_turned_inertial_frame_is_planned_too(capture, settings):
    """Pitch 90 deg at the goal, where the paper's Euler angles do not exist."""
    goal = pin.Quaternion(capture.target.quaternion_xyzw).toRotationMatrix()
    rotation = pin.utils.rotate("y", np.pi / 2) @ goal.T
    problem = turned(replace(capture, objective=LENGTH), rotation, np.array([10.0, -5.0, 2.0]))
    answer = plan(problem, settings)
    assert answer.orientation_reading == "along_turn"
    assert answer.metrics.min_clearance >= 0.0
    assert answer.metrics.joint_path_length <= 1.2


def test_a_start_inside_an_obstacle_is_refused_by_obstacle_and_link(capture, settings):
    blocked = Obstacle.sphere("debris", np.array([0.25, 0.1, 0.6]), 0.2)
    with pytest.raises(InvalidInput, match=r"obstacles\[debris\].*joint_1") as refusal:
        plan(replace(capture, obstacles=(blocked,)), settings)
    assert refusal.value.status is Status.START_IN_COLLISION


def test_a_start_outside_the_joint_limits_is_refused_by_joint(capture, settings):
    joints = capture.start.joint_positions.copy()
    joints[4] = 3.5
    with pytest.raises(InvalidInput, match=r"joint_5.*3\.5") as refusal:
        plan(replace(capture, start=replace(capture.start, joint_positions=joints)), settings)
    assert refusal.value.status is Status.START_OUTSIDE_LIMITS


def test_a_stretched_arm_cannot_start_on_the_papers_path(capture, settings):
    """Elbow at 90 deg: upper arm and forearm in line, nothing moves the wrist along them."""
    joints = np.array([0.3, 0.0, 0.0, np.pi / 2, 0.5, 0.0, 0.1])
    start = replace(capture.start, joint_positions=joints)
    papers = replace(capture, start=start, obstacles=(), parametrisation=PAPERS)
    with pytest.raises(InvalidInput, match="every direction") as refusal:
        plan(papers, settings)
    assert refusal.value.status is Status.START_SINGULAR


def test_rounding_beyond_a_joint_limit_is_not_refused(capture, settings):
    """A joint that the sensor reads 1e-8 rad beyond its limit stands at its limit.

    Its rate leads away from the limit, which it would leave behind otherwise whatever the path.
    """
    upper = capture.robot.upper_position_limits.copy()
    joint = int(capture.start.joint_velocities.argmin())
    upper[joint] = capture.start.joint_positions[joint] - 1e-8
    robot = replace(capture.robot, upper_position_limits=upper)
    answer = plan(replace(capture, robot=robot, objective=LENGTH), settings)
    assert answer.metrics.min_joint_margin >= -1e-6


def test_a_start_faster_than_a_joint_may_be_is_refused_by_joint_where_rates_are_limited(
    capture, settings
):
    rates = capture.start.joint_velocities.copy()
    rates[2] = -0.6
    start = replace(capture.start, joint_velocities=rates)
    fast = replace(capture, start=start, limits=Limits(joint_velocities=True))
    with pytest.raises(
        InvalidInput, match=r"joints\.velocity\[joint_3\] is -0\.6.*0\.5"
    ) as refusal:
        plan(fast, settings)
    assert refusal.value.status is Status.START_OUTSIDE_LIMITS
    answer = plan(replace(fast, limits=Limits(joint_velocities=False), obstacles=()), settings)
    assert answer.trajectory.joint_velocities[0] == pytest.approx(rates, abs=1e-9)


@pytest.mark.law("PLAN-05")
def test_joint_rates_are_kept_within_their_limits_where_they_are_limited(
    capture, settings, shortest
):
    """A limit of nine tenths of the fastest rate makes the path a little longer."""
    limit = 0.9 * np.abs(shortest.trajectory.joint_velocities).max()
    robot = replace(capture.robot, velocity_limits=np.full(7, limit))
    slow = replace(capture, robot=robot, objective=LENGTH, limits=Limits(joint_velocities=True))
    answer = plan(slow, settings)
    _, _, rates, _ = joints_between(answer.trajectory, 1000)
    fastest = np.abs(rates).max()
    assert fastest == pytest.approx(limit, rel=3e-4)
    assert fastest <= limit + 1e-6
    assert answer.metrics.min_velocity_margin == pytest.approx(limit - fastest, abs=1e-8)
    longer = answer.metrics.joint_path_length / shortest.metrics.joint_path_length
    assert 1.0 < longer < 1.02


def test_without_velocity_limits_a_plan_is_the_one_whose_limits_are_out_of_reach(capture, settings):
    def planned(limits):
        robot = replace(capture.robot, velocity_limits=limits)
        free = replace(capture, robot=robot, objective=LENGTH, limits=Limits(joint_velocities=True))
        return plan(free, replace(settings, starts=1))

    far, none = planned(np.full(7, 1e3)), planned(np.full(7, np.inf))
    some = planned(np.array([np.inf, *[1e3] * 6]))
    for answer in (none, some):
        np.testing.assert_array_equal(
            answer.trajectory.joint_positions, far.trajectory.joint_positions
        )
    assert none.metrics.min_velocity_margin == np.inf
    assert some.metrics.min_velocity_margin == pytest.approx(
        1e3 - np.abs(far.trajectory.joint_velocities[:, 1:]).max(), abs=1e-2
    )


def test_a_duration_too_short_for_the_velocity_limits_is_refused_and_a_longer_one_is_not(
    capture, settings
):
    """Both turn the end effector by 90 deg, the second in ten times the time."""
    turned_goal = pin.Quaternion(capture.target.quaternion_xyzw).toRotationMatrix() @ pin.exp3(
        np.array([0.0, 0.0, np.pi / 2])
    )
    problem = replace(
        capture,
        objective=LENGTH,
        obstacles=(),
        target=replace(capture.target, quaternion_xyzw=pin.Quaternion(turned_goal).coeffs()),
        limits=Limits(joint_velocities=True),
    )
    hurried = replace(settings, starts=1, max_iterations=10)
    with pytest.raises(
        NoPlanFound, match=r"moves at .* rad/s beyond.*a longer duration"
    ) as refusal:
        plan(replace(problem, duration=1.5), hurried)
    assert refusal.value.status is Status.LIMIT_VIOLATED
    assert refusal.value.attempt.metrics.min_velocity_margin < -0.1
    assert plan(replace(problem, duration=15.0), settings).metrics.min_velocity_margin > 0.0


@pytest.mark.parametrize(
    ("allowed", "points"),
    [(0, None), (9, 13), (13, 25)],
)
def test_a_search_that_is_ended_tells_how_far_it_came(capture, settings, allowed, points):
    """It holds the refusal that `perform` raises, with the best attempt until then."""
    calls = count(1)

    class Impatient(Watch):
        def require_time(self, *_):
            if next(calls) > allowed:
                raise OutOfTime("the patience of this test is at its end")

    with pytest.raises(OutOfTime, match="patience of this test") as end:
        plan(replace(capture, objective=LENGTH), settings, Impatient())
    refusal = end.value.refusal
    assert re.search(r"patience of this test.*more time", refusal.constraint)
    assert refusal.status is Status.TIMED_OUT
    assert next(calls) == allowed + 2
    attempt = refusal.attempt
    assert (None if attempt is None else len(attempt.trajectory.time)) == points
    if points is not None:
        assert f"the best attempt so far, on {points} points" in str(refusal)


def test_who_could_have_ended_a_search_does_not_change_its_answer(capture, settings, shortest):
    calls = count()

    class Counting(Watch):
        def require_time(self, *_):
            next(calls)

    answer = plan(replace(capture, objective=LENGTH), settings, Counting())
    assert answer.xi.tobytes() == shortest.xi.tobytes()
    assert next(calls) >= answer.solver.iterations


def test_a_plan_is_a_first_guess_for_another_plan(capture, settings, shortest):
    problem = replace(capture, objective=LENGTH)
    again = plan(problem, settings, first_guess=shortest.coefficients)
    assert again.solver.starts == 1
    assert again.solver.iterations < shortest.solver.iterations / 2
    assert again.metrics.joint_path_length == pytest.approx(
        shortest.metrics.joint_path_length, rel=1e-3
    )
    assert shortest.family == again.family == "end_effector_polynomial"


@pytest.mark.law("PLAN-26")
def test_a_guess_that_leads_nowhere_does_not_cost_a_plan(capture, settings, shortest):
    """From a path far away the search finds nothing, and goes on as if there had been no guess."""
    problem = replace(capture, objective=LENGTH, parametrisation=PAPERS)
    far = np.full(shortest.coefficients.shape, 3.0)
    for starts in (1, settings.starts):
        found = plan(problem, replace(settings, starts=starts), first_guess=far)
        assert found.solver.starts == 2
        assert found.xi.tobytes() == shortest.xi.tobytes()


def test_a_guess_that_takes_too_long_leaves_the_search_its_time(
    capture, settings, shortest, monkeypatch
):
    """What ends it is a count of its own: the plan is that without it, whatever the clock says."""
    problem = replace(capture, objective=LENGTH)
    for looks in (0, 2):
        monkeypatch.setattr(guided_search, "_LOOKS", looks)
        found = plan(problem, settings, first_guess=shortest.coefficients)
        assert found.solver.starts == 2, looks
        assert found.xi.tobytes() == shortest.xi.tobytes(), looks


@pytest.mark.parametrize("guess", [np.zeros(17), np.full(18, np.nan), np.zeros((6, 3)), [[1], []]])
@pytest.mark.parametrize("window", [None, DurationRange(8.0, 10.0)])
@pytest.mark.parametrize("ways", [1, 2])
def test_a_first_guess_that_is_no_path_is_refused(capture, settings, guess, window, ways):
    """Of two ways round, of which the guess may be either, as of one."""
    problem = replace(capture, duration_range=window)
    if ways == 2:  # half a turn leads there either way
        problem = replace(problem, target=half_turn(problem))
    assert len(path_families(problem, settings)[0]) == ways
    with pytest.raises(InvalidInput) as refusal:
        plan(problem, settings, first_guess=guess)
    assert refusal.value.field == "first_guess"


def half_turn(problem):
    """The target of a problem, turned until the way there is half a turn."""
    begun = start_motion(problem.robot, problem.start, problem.duration).end_effector
    there = begun.rotation_ee_to_inertial @ np.diag([-1.0, -1.0, 1.0])
    return replace(problem.target, quaternion_xyzw=pin.Quaternion(there).coeffs())


@pytest.mark.parametrize("has_guess", [False, True])
def test_evaluations_on_all_points_are_told_as_refining(capture, settings, shortest, has_guess):
    told = list[Progress]()

    class Listening(Watch):
        def report(self, progress):
            told.append(progress)

    guess = shortest.coefficients if has_guess else None
    plan(replace(capture, objective=LENGTH), settings, Listening(), guess)
    phases = list(dict.fromkeys(progress.phase for progress in told))
    assert phases == [SEARCHING, REFINING, CHECKING]


def test_evaluations_of_a_race_count_for_a_guess():
    """As many as it may have, one after the other or beside others."""
    for has_range, looks in ((False, 120), (True, 480)):
        allowance = Allowance(Watch(), has_range)
        for _ in range(looks // 12 - 1):
            allowance.passed(12)
        for _ in range(12):
            allowance.require_time()
        allowance.require_time(CHECKING)
        assert not allowance.used_up
        with pytest.raises(OutOfTime):
            allowance.passed(12)
        assert allowance.used_up


def test_a_search_whose_best_attempt_violates_nothing_says_so(
    capture, settings, shortest, monkeypatch
):
    """On few points a path may keep every constraint that its finer ones did not."""
    monkeypatch.setattr(multi_start, "_coarse_paths", lambda *_: iter(()))
    monkeypatch.setattr(GridSolver, "best_attempt", lambda _: (shortest, [], 0.0))
    with pytest.raises(NoPlanFound, match=r"keeps every constraint.*more planner\.starts") as found:
        plan(replace(capture, objective=LENGTH, parametrisation=PAPERS), settings)
    assert (found.value.status, found.value.requirement) == (Status.CHECK_FAILED, "")
    assert found.value.attempt is shortest


def test_how_a_search_ended_is_not_read_from_words(capture, settings, monkeypatch):
    words = {stop: f"whatever it is called: {stop}" for stop in Stop if stop is not Stop.ENOUGH}
    problem = replace(capture, objective=LENGTH)
    before = plan(problem, settings).solver
    monkeypatch.setattr(solver, "_REASONS", words)
    after = plan(problem, settings).solver
    assert before.ended_by is after.ended_by is EndedBy.CONVERGED
    assert after.rollouts == before.rollouts


def test_a_goal_that_no_posture_reaches_is_refused_with_the_reach(capture, settings):
    far = replace(capture.target, position=np.array([9.0, 0.4, 0.6]))
    with pytest.raises(NoPlanFound, match=r"target\.position.*reaches at most") as refusal:
        plan(replace(capture, target=far), settings)
    assert refusal.value.status is Status.GOAL_OUT_OF_REACH


def test_the_drift_counts_for_the_reach(capture, settings):
    """What is out of reach now comes into reach when the system drifts there."""
    position = capture.start.position_chaser_in_inertial
    start = replace(capture.start, linear_velocity_chaser_in_inertial=np.array([0.5, 0.0, 0.05]))
    ahead = replace(capture.target, position=position + np.array([6.0, 0.4, 1.1]))
    with pytest.raises(NoPlanFound) as refusal:
        plan(replace(capture, target=ahead, obstacles=()), settings)
    assert refusal.value.status is Status.GOAL_OUT_OF_REACH
    drifting = replace(capture, start=start, target=ahead, obstacles=(), objective=LENGTH)
    with_velocity_of_drift = replace(settings, start_velocity_tolerance=10.0)
    assert plan(drifting, with_velocity_of_drift).metrics.final_position_error < 1e-3


def test_a_goal_inside_an_obstacle_is_refused_by_obstacle(capture, settings):
    around_goal = Obstacle.sphere(
        "clamp", capture.target.position + np.array([0.0, 0.0, 0.05]), 0.1
    )
    with pytest.raises(NoPlanFound, match="inside obstacle clamp") as refusal:
        plan(replace(capture, obstacles=(around_goal,)), settings)
    assert refusal.value.status is Status.COLLISION


@pytest.mark.law("PLAN-28")
def test_a_goal_behind_a_wall_is_refused_with_the_collision_and_the_attempt(capture, settings):
    wall = tuple(
        Obstacle.sphere(f"wall_{y}_{z}", np.array([1.25, y, z]), 0.3)
        for y in np.arange(-2.0, 3.0, 0.4)
        for z in np.arange(-2.0, 3.0, 0.4)
        if np.linalg.norm([1.25 - 0.8, y - 0.4, z - 0.6]) > 0.31
    )
    with pytest.raises(NoPlanFound, match=r"m inside obstacle wall_.*at t = ") as refusal:
        plan(
            replace(capture, obstacles=wall, objective=LENGTH),
            replace(settings, starts=2, max_iterations=20),
        )
    assert refusal.value.status is Status.COLLISION
    assert refusal.value.attempt is not None
    assert refusal.value.attempt.metrics.penalty > 0.0


def test_a_goal_beyond_the_edge_of_the_workspace_is_refused_as_singular(capture, settings):
    beyond = replace(capture.target, position=np.array([3.6, 0.4, 0.6]))
    problem = replace(capture, target=beyond, obstacles=(), parametrisation=PAPERS)
    with pytest.raises(NoPlanFound, match=r"singularity at .*t = \d") as refusal:
        plan(problem, replace(settings, starts=1))
    assert refusal.value.status is Status.SINGULAR


@pytest.mark.law("NODE-02")
def test_the_search_goes_on_when_the_check_refuses_what_it_found(capture, settings):
    """Near the workspace's edge the straight path leads the solver through a singularity."""
    edge = replace(capture.target, position=np.array([3.35, 0.4, 0.6]))
    problem = replace(capture, target=edge, obstacles=(), parametrisation=PAPERS)
    with pytest.raises(NoPlanFound, match=r"the only attempt, .*final_position_error"):
        plan(problem, replace(settings, starts=1))
    answer = plan(problem, settings)
    assert answer.solver.starts > 1
    assert answer.metrics.final_position_error < 1e-3
    assert answer.metrics.min_singular_value > settings.singular_value_threshold


def test_null_space_motion_at_the_start_is_carried_in(capture, settings):
    """Joint rates that are not those of Eq. (31)."""
    rates = capture.start.joint_velocities + 0.1
    start: SystemState = replace(capture.start, joint_velocities=rates)
    answer = plan(replace(capture, start=start, objective=LENGTH), settings)
    assert answer.trajectory.joint_velocities[0] == pytest.approx(rates, abs=1e-9)
    assert answer.metrics.min_clearance >= 0.0


def test_a_path_that_is_singular_on_fewer_points_leads_to_splines_too(capture, settings, shortest):
    """Its plan's own points are followed, where the few samples of a seed meet a singularity."""

    class SingularOnFew:
        def motion(self, x, _points):
            no = np.empty(0)
            return Motion(x=x, q=no, v=no, q_half_way=no, goal_error=no, singular_at=1.0)

    splines = joint_splines(capture, settings)
    found = planner._Found(SingularOnFew(), shortest)
    seed = planner._seed(capture.robot, splines, found)
    along = splines.motion(seed, len(shortest.trajectory.time)).q[:, 7:]
    assert along == pytest.approx(shortest.trajectory.joint_positions, abs=0.01)


def test_a_start_that_is_singular_is_refused_for_the_papers_path_alone(capture, settings):
    """All axes of a stretched arm are in one plane."""
    rest = np.zeros(capture.robot.joints)
    start = replace(capture.start, joint_positions=rest, joint_velocities=rest)
    problem = replace(capture, start=start, parametrisation=PAPERS, obstacles=())
    with pytest.raises(InvalidInput) as refusal:
        require_plannable(problem, settings)
    assert refusal.value.status is Status.START_SINGULAR
    require_plannable(replace(problem, parametrisation=Parametrisation.JOINT_SPLINE), settings)
