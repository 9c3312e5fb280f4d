"""Goals of the joints: a posture, or rest in any, and the shortest way there."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import yaml
from core_rows import sensitivity_of
from reference_joint_spline import hulls
from robots import CONFIG, LEMUR_SCENARIO, LEMUR_URDF
from scipy.optimize import linprog

from ff_planner_benchmark.problems import captured, joint_goals
from ff_planner_ros.analysis.drawing.figures import plot_plan
from ff_planner_ros.analysis.plan_document import plan_document
from ff_planner_ros.analysis.plan_json import plan_dictionary
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.check.check import failures
from ff_planner_ros.planning.check.preconditions import require_plannable, require_time
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.system_frame import in_own_frame, system_frame
from ff_planner_ros.planning.optimisation.free_program import goal_motion
from ff_planner_ros.planning.paths.joint_spline import JointSplines, joint_splines
from ff_planner_ros.planning.problem.problem import (
    Approach,
    DurationRange,
    Limits,
    Objective,
    PlanningProblem,
    Posture,
    lasting,
)
from ff_planner_ros.planning.scenario.scenario import Defaults, load_scenario, load_task
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.search import free_moment
from ff_planner_ros.planning.search.candidate import Effort
from ff_planner_ros.planning.search.free_search import FreeSearch
from ff_planner_ros.planning.search.planner import NOBODY
from ff_planner_ros.planning.task.tail import EndBehaviour
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import Base, load_robot, robot_from_urdf_text
from ff_planner_ros.robot.momentum import total_momenta
from ff_planner_ros.simulation.verification import verify

SETTINGS = load_parameters().planner
STOW = CONFIG / "scenarios/stow.yaml"
FOLDED = np.array([0.0, -0.5, 0.3, -0.8, -1.0, 0.5, -1.0])
MOVING = np.array([0.02, -0.01, 0.03, 0.0, 0.01, -0.02, 0.01])
GOALS = {
    "posture": Posture(FOLDED),
    "moving": Posture(FOLDED, MOVING),
    "rest": Posture(at_rest=True),
}


def asking(posture: Posture, **changes: Any) -> PlanningProblem:
    return replace(load_scenario(LEMUR_SCENARIO), posture=posture, **changes)


@pytest.fixture(scope="module", params=GOALS)
def solved(request: pytest.FixtureRequest) -> tuple[PlanningTask, Plan]:
    """A plan to each goal."""
    task = PlanningTask(asking(GOALS[request.param]), SETTINGS)
    return task, perform(task)


def test_the_joints_are_where_they_shall_be_and_nothing_pushes_the_system(
    solved: tuple[PlanningTask, Plan],
) -> None:
    task, plan = solved
    posture, motion = task.problem.posture, plan.trajectory
    assert posture is not None
    np.testing.assert_allclose(motion.joint_velocities[-1] - posture.rates, 0.0, atol=1e-12)
    np.testing.assert_allclose(motion.joint_accelerations[-1], 0.0, atol=1e-10)
    if posture.positions is not None:
        np.testing.assert_allclose(motion.joint_positions[-1], posture.positions, atol=1e-12)
    robot = task.problem.robot
    momenta = total_momenta(robot, *from_trajectory(robot, motion))
    np.testing.assert_allclose(momenta - momenta[0], 0.0, atol=1e-6)
    assert verify(robot, motion).passed
    assert plan.family == "joint_spline"


def endless(problem: PlanningProblem, turns: int) -> PlanningProblem:
    """Return the problem with a continuous joint 3 that has counted so many turns."""
    text = LEMUR_URDF.read_text().replace(
        '<joint name="joint_3" type="revolute">', '<joint name="joint_3" type="continuous">'
    )
    robot = robot_from_urdf_text(text, "chaser", "end_effector", geometry=Geometry.LINES)
    by, goal = turns * 2.0 * np.pi * (np.arange(7) == 2), problem.posture
    start = replace(problem.start, joint_positions=problem.start.joint_positions + by)
    if goal is not None and goal.positions is not None:
        goal = replace(goal, positions=goal.positions + by)
    return replace(problem, robot=robot, start=start, posture=goal)


@pytest.mark.parametrize("posture", [None, Posture(FOLDED), Posture(at_rest=True)])
def test_a_plan_is_the_same_whatever_turn_a_continuous_joint_has_counted(
    posture: Posture | None,
) -> None:
    """It goes on from the measured positions, on which a controller goes on, too."""
    plain = endless(replace(load_scenario(LEMUR_SCENARIO), posture=posture), 0)
    first = perform(PlanningTask(plain, SETTINGS))
    for turns in (-3, 2, 400):
        problem = endless(replace(load_scenario(LEMUR_SCENARIO), posture=posture), turns)
        plan = perform(PlanningTask(problem, SETTINGS))
        motion, by = plan.trajectory, turns * 2.0 * np.pi * (np.arange(7) == 2)
        np.testing.assert_allclose(
            motion.joint_positions[0], problem.start.joint_positions, rtol=0.0, atol=1e-9
        )
        np.testing.assert_allclose(
            motion.joint_positions - by, first.trajectory.joint_positions, rtol=0.0, atol=1e-5
        )
        assert plan.metrics.min_joint_margin == pytest.approx(
            first.metrics.min_joint_margin, abs=1e-5
        )
        assert verify(problem.robot, motion).passed


def test_a_goal_further_round_than_two_turns_meets_a_bound_that_is_not_the_urdfs() -> None:
    far = Posture(FOLDED + 7.0 * np.pi * (np.arange(7) == 2))
    with pytest.raises(InvalidInput, match=r"joint_3.*the planner's: the joint is continuous"):
        replace(endless(asking(Posture(FOLDED)), 0), posture=far)
    with pytest.raises(InvalidInput) as refused:
        asking(far)  # whose joint has limits
    assert "planner" not in str(refused.value)
    # An angle that has no digits left for a plan.
    with pytest.raises(InvalidInput, match=r"joints\.position.joint_3.*the planner's"):
        perform(PlanningTask(endless(asking(Posture(at_rest=True)), 10**9), SETTINGS))


def test_a_joint_that_goes_the_long_way_round_is_told_in_the_answer() -> None:
    problem = endless(asking(Posture(FOLDED)), 0)
    start = np.where(np.arange(7) == 2, 3.0, problem.start.joint_positions)
    at = replace(problem.start, joint_positions=start)
    goal = Posture(np.where(np.arange(7) == 2, -3.0, FOLDED))
    plan = perform(PlanningTask(replace(problem, start=at, posture=goal, duration=60.0), SETTINGS))
    assert plan.trajectory.joint_positions[-1, 2] == pytest.approx(-3.0)
    words = "joint_3 turns by 6 rad to -3 rad, and 3.283 rad, the same posture, is 0.283 rad away"
    assert plan.notes == (words,)
    assert words in plan.message
    # The joint that has limits may not be there, and the short way has no note.
    assert not any(
        "the same posture" in note
        for note in perform(PlanningTask(asking(Posture(FOLDED)), SETTINGS)).notes
    )


def test_the_answer_tells_how_all_turns_together_at_rest(solved: tuple[PlanningTask, Plan]) -> None:
    task, plan = solved
    posture, robot = task.problem.posture, task.problem.robot
    assert posture is not None
    if posture.rates.any():
        assert plan.turn_rate_at_rest is None
        assert "at rest" not in plan.message
        return
    # All is one body then, whose inertia and angular momentum say how it turns.
    q, v = (rows[-1] for rows in from_trajectory(robot, plan.trajectory))
    data = robot.model.createData()
    pin.ccrba(robot.model, data, q, v)
    rate = np.linalg.solve(np.asarray(data.Ig.inertia), np.asarray(data.hg.angular))
    assert plan.turn_rate_at_rest == pytest.approx(np.linalg.norm(rate), rel=1e-9)
    assert (
        f"with joints at rest the system turns at {plan.turn_rate_at_rest:.4g} rad/s"
        in plan.message
    )


@pytest.mark.parametrize("name", GOALS)
def test_all_derivatives_are_those_of_finite_differences(name: str) -> None:
    window = DurationRange(6.0, 12.0)
    problem = in_own_frame(asking(GOALS[name], duration=9.0, duration_range=window))
    family = joint_splines(problem, SETTINGS)
    rng = np.random.default_rng(0)
    x = family.near(np.hstack([np.zeros((20, 7)), np.linspace(0, 1, 20)[:, None] * FOLDED]))
    x = x + 0.1 * rng.normal(size=family.variables)
    by, step = rng.normal(size=len(x)), 1e-6

    def lasts(way: float) -> JointSplines:
        return family.lasting(lasting(problem, 9.0 + way), goal_motion(problem, 9.0 + way))

    def at(way: float) -> Any:
        return lasts(way).motion(x + way * by, 9)

    here = family.lasting(lasting(problem, 9.0), goal_motion(problem, 9.0))
    found = sensitivity_of(here, here.motion(x, 9))
    low, high = at(-step), at(step)
    along = np.append(by, 1.0)
    np.testing.assert_allclose(found.v @ along, (high.v - low.v) / (2 * step), atol=1e-7)
    joints = (high.q[:, 7:] - low.q[:, 7:]) / (2 * step)
    np.testing.assert_allclose(found.q[:, 6:] @ along, joints, atol=1e-7)
    below, above = (hulls(lasts(way), x + way * by)[1][0] for way in (-step, step))
    rates_by_x = hulls(here, x)[1][1]
    np.testing.assert_allclose(rates_by_x @ along, (above - below) / (2 * step), atol=1e-7)
    assert found.goal_error.shape == (0, family.variables + 1)


def test_the_shortest_stop_is_as_short_as_the_accelerations_allow() -> None:
    start = load_scenario(LEMUR_SCENARIO).start
    start = replace(start, joint_velocities=np.array([0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    problem = asking(
        Posture(at_rest=True),
        start=start,
        duration=20.0,
        duration_range=DurationRange(0.5, 20.0),
        objective=Objective(0.0, 0.0, 1.0),
        limits=Limits(joint_velocities=False, joint_accelerations=(0.1,)),
        obstacles=(),
    )
    plan = perform(PlanningTask(problem, SETTINGS))
    assert plan.duration is not None
    # At constant deceleration 2 s; from zero to it and back takes longer, never twice as long.
    assert 2.0 < plan.duration < 4.0
    assert np.abs(plan.trajectory.joint_accelerations).max() <= 0.1 * (1 + 1e-3)
    assert plan.metrics.min_acceleration_margin > -1e-5
    shorter = replace(problem, duration=0.9 * plan.duration, duration_range=None)
    with pytest.raises(Exception, match="acceleration"):
        perform(PlanningTask(shorter, replace(SETTINGS, starts=3)))


def test_a_motion_that_ends_elsewhere_is_refused_by_the_check() -> None:
    problem = asking(Posture(FOLDED))
    plan = perform(PlanningTask(problem, SETTINGS))
    seen = system_frame(problem.robot, problem.start).plan(plan)
    other = in_own_frame(asking(Posture(FOLDED + 0.01)))
    assert [one.status for one in failures(other, seen, SETTINGS)] == [Status.CHECK_FAILED]
    (failure,) = failures(other, seen, SETTINGS)
    assert "is further than asked by -0.01 rad" in failure.finding
    moving = in_own_frame(asking(Posture(FOLDED, MOVING)))
    (failure,) = failures(moving, seen, SETTINGS)
    assert "joint_3 is faster than asked by -0.03 rad/s" in failure.finding


def test_a_scenario_and_an_answer_hold_the_goal(tmp_path: Path) -> None:
    for name, posture in GOALS.items():
        task = PlanningTask(asking(posture), SETTINGS)
        write_scenario(task, tmp_path / f"{name}.yaml")
        again = load_task(tmp_path / f"{name}.yaml", Defaults(SETTINGS))
        assert again.digest == task.digest
        written = yaml.safe_load((tmp_path / f"{name}.yaml").read_text())["target"]
        assert written.keys() == ({"at_rest"} if posture.at_rest else {"joints"})
    digests = {PlanningTask(asking(one), SETTINGS).digest for one in GOALS.values()}
    assert len(digests) == len(GOALS)
    task = PlanningTask(asking(GOALS["rest"]), SETTINGS)
    plan = perform(task)
    answer = json.loads(json.dumps(plan_dictionary(plan, task, 0.1)))
    assert answer["target"] == {"at_rest": True}
    assert answer["turn_rate_at_rest"] == plan.turn_rate_at_rest
    document = plan_document(answer)
    assert document.scene.target is None
    assert plot_plan(task.problem, plan, tmp_path / "drawn")


def test_the_stow_scenario_is_planned_in_a_duration_of_its_own_and_stops_its_joints() -> None:
    task = load_task(STOW, Defaults(SETTINGS))
    plan = perform(replace(task, settings=replace(SETTINGS, starts=4)))
    assert plan.duration is not None
    assert 5.0 < plan.duration < 20.0
    assert plan.metrics.min_clearance >= 0.0
    assert verify(task.problem.robot, plan.trajectory).passed
    with pytest.raises(InvalidInput, match=r"end_behaviour .*the goal has no place"):
        replace(task, end_behaviour=EndBehaviour.HOLD_END_EFFECTOR, tail=1.0)


def test_wheels_hold_a_chaser_that_stows_its_arm() -> None:
    problem = load_scenario(CONFIG / "scenarios/lemur_wheels.yaml")
    plan = perform(PlanningTask(replace(problem, posture=Posture(FOLDED)), SETTINGS))
    assert problem.robot.base is Base.ATTITUDE_HELD
    assert plan.turn_rate_at_rest == 0.0
    assert plan.wheels is not None
    assert max(plan.metrics.peak_wheel_momenta) <= 4.0 + 1e-6


def refused(path: Path) -> InvalidInput:
    with pytest.raises(InvalidInput) as found:
        load_task(path, Defaults(SETTINGS))
    return found.value


@pytest.mark.parametrize(
    ("target", "field"),
    [
        ({"joints": {"position": [0.0] * 6}}, "target.joints.position"),
        ({"joints": {"position": [9.0] * 7}}, "target.joints.position[joint_1]"),
        ({"joints": {"position": [0.0] * 7, "velocity": [1.0]}}, "target.joints.velocity"),
        (
            {"joints": {"position": [0.0] * 7, "velocity": [9.0] * 7}},
            "target.joints.velocity[joint_1]",
        ),
        ({"at_rest": False}, "target.at_rest"),
        ({"at_rest": True, "joints": {"position": [0.0] * 7}}, "target.at_rest"),
        ({"at_rest": True, "position": [0.0] * 3}, "target.position"),
    ],
)
def test_a_goal_of_the_joints_that_is_none_is_refused_by_name(
    tmp_path: Path, target: dict[str, Any], field: str
) -> None:
    document = yaml.safe_load(STOW.read_text())
    document["robot"]["urdf"] = str(CONFIG / "robots/lemur/lemur.urdf")
    document["target"] = target
    (tmp_path / "s.yaml").write_text(yaml.safe_dump(document))
    assert refused(tmp_path / "s.yaml").field == field


def test_a_posture_just_beyond_a_limit_is_told_with_all_its_digits() -> None:
    robot = asking(Posture(FOLDED)).robot
    limit = float(robot.upper_position_limits[0])
    beyond = float(np.nextafter(limit, np.inf))
    with pytest.raises(InvalidInput) as found:
        Posture(np.array([beyond, *FOLDED[1:]])).require_fits(robot, keeps_rates=True)
    assert f"{beyond!r} rad" in str(found.value)
    assert f"to {limit!r} rad" in str(found.value)


@pytest.mark.parametrize(
    ("folded", "pair"),
    [
        ([0.0, 1.8, 0.0, -2.7, 0.0, -1.8, 0.0], ("link_4#2", "link_7")),
        ([0.0, 2.6, 0.0, 2.7, 0.0, -0.4, 0.0], ("chaser", "link_3")),
    ],
)
def test_a_posture_in_which_the_robot_touches_itself_is_refused_before_the_search(
    folded: list[float], pair: tuple[str, str]
) -> None:
    """Neither a longer duration nor more guesses can help, and neither is offered."""
    robot = load_robot(LEMUR_URDF, "chaser", "end_effector", geometry=Geometry.SHAPES)
    problem = asking(Posture(np.array(folded)), robot=robot)
    for seen in (problem, replace(problem, duration=100.0)):
        with pytest.raises(NoPlanFound) as refused:
            require_plannable(seen, SETTINGS)
        told = str(refused.value)
        assert refused.value.status is Status.COLLISION
        assert all(name in told for name in pair)
        assert "choose another posture" in told
        assert "duration" not in told
    require_plannable(asking(Posture(FOLDED), robot=robot), SETTINGS)


def test_what_needs_a_place_of_the_goal_is_refused_with_a_goal_of_the_joints() -> None:
    corridor = Approach(direction=np.array([1.0, 0.0, 0.0]), distance=0.1)
    with pytest.raises(InvalidInput, match=r"approach .*the goal has no place"):
        asking(Posture(FOLDED), approach=corridor)


@pytest.mark.parametrize("number", range(2))
def test_a_stop_takes_hardly_longer_than_the_shortest_that_a_linear_program_allows(
    number: int,
) -> None:
    problem = joint_goals.problem("stop", number).problem
    found = perform(PlanningTask(problem, SETTINGS))
    assert found.duration is not None
    assert not may_stop_in(problem, found.duration / 1.005)
    assert may_stop_in(problem, found.duration)
    assert found.solver.starts == 2


def may_stop_in(problem: PlanningProblem, duration: float) -> bool:
    """Tell whether splines may stop then, within the joints' own limits at 200 times alone."""
    family = joint_splines(lasting(problem, duration), SETTINGS)
    robot, limits, basis = problem.robot, problem.limits, family.basis
    assert limits.joint_accelerations is not None
    bounds = (
        (robot.lower_position_limits, robot.upper_position_limits),
        (-robot.velocity_limits, robot.velocity_limits),
        (-np.array(limits.joint_accelerations), np.array(limits.joint_accelerations)),
    )
    for joint in range(robot.joints):
        rows, most = [], []
        for order, (lowest, highest) in enumerate(bounds):
            on_grid = basis.on_grid(201, order)[1:]
            by_x, known = family.free(on_grid), family.known(on_grid)[:, joint]
            rows += [by_x, -by_x]
            most += [highest[joint] - known, known - lowest[joint]]
        free = np.zeros(family.each)
        if not linprog(
            free, np.concatenate(rows), np.concatenate(most), bounds=(None, None)
        ).success:
            return False
    return True


def test_a_glance_at_the_joints_alone_tells_what_the_linear_program_does() -> None:
    problem = joint_goals.problem("stop", 0).problem
    family = joint_splines(problem, SETTINGS)
    shortest = next(
        duration for duration in np.geomspace(1.0, 5.0, 100) if may_stop_in(problem, duration)
    )
    for part, is_possible in ((0.97, False), (1.03, True)):
        longest = part * shortest
        window = DurationRange(problem.durations.minimum, longest)
        fixed = lasting(problem, longest)
        search = FreeSearch(
            replace(fixed, duration_range=window),
            fixed,
            family.lasting(fixed),
            SETTINGS,
        )
        guess = next(search.guesses())
        found = search.glance(guess, NOBODY, Effort(), joints_alone=True)
        assert (found is not None) is is_possible


@pytest.mark.ci
@pytest.mark.parametrize("bodies", [False, True])
def test_a_stop_that_the_joints_alone_allow_no_sooner_needs_no_other_guesses(
    bodies: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With all of them the planner finds none that is sooner by what counts."""
    task = PlanningTask(joint_goals.problem("stop", 0).problem, SETTINGS)
    if bodies:
        task = captured.problem("captured stop", 0).task(SETTINGS)
        assert task.problem.robot.pairs
    found = perform(task)
    glance = FreeSearch.glance

    def as_if_there_were_one(
        search: FreeSearch, guess: Array, *watched: Any, joints_alone: bool = False
    ) -> Array | None:
        return guess if joints_alone else glance(search, guess, *watched)

    monkeypatch.setattr(FreeSearch, "glance", as_if_there_were_one)
    thorough = perform(task)
    assert found.solver.starts < thorough.solver.starts / 2
    assert found.duration is not None
    assert thorough.duration is not None
    assert found.duration <= thorough.duration * (1.0 + free_moment.SOONER)


def test_no_time_is_refused_in_which_a_joint_alone_can_be_as_asked() -> None:
    """By the fastest way there is: full acceleration, then full deceleration, in closed form."""
    problem = joint_goals.problem("stow", 0).problem
    robot, limit = problem.robot, 0.2
    rng = np.random.default_rng(5)
    limits = Limits(joint_accelerations=(limit,) * robot.joints)
    for _ in range(20):
        v0, v1, speeds_up, slows_down = rng.uniform([-0.1, -0.1, 0.1, 0.1], [0.1, 0.1, 2.0, 2.0])
        sign = rng.choice([-1.0, 1.0])
        top = v0 + sign * limit * speeds_up
        slows_down = max((top - v1) * sign / limit, 0.0)
        if slows_down == 0.0 or sign * top < 0.05:  # it goes back on the way
            continue
        way = (v0 + top) / 2.0 * speeds_up + (top + v1) / 2.0 * slows_down
        begin = problem.start.joint_positions
        first = np.eye(robot.joints)[0]
        start = replace(problem.start, joint_velocities=v0 * first)
        wide = replace(
            robot,
            lower_position_limits=np.full(robot.joints, -99.0),
            upper_position_limits=np.full(robot.joints, 99.0),
        )
        asked = replace(
            problem,
            robot=wide,
            start=start,
            posture=Posture(begin + way * first, v1 * first),
            limits=limits,
            obstacles=(),
        )
        enough = replace(asked, duration=speeds_up + slows_down)
        require_time(enough)
        with pytest.raises(
            NoPlanFound, match="s is too short for joint joint_1 to reach the posture"
        ) as short:
            require_time(replace(asked, duration=0.99 * enough.duration))
        kept = "velocity and acceleration" if limits.joint_velocities else "acceleration"
        assert f"within the limits of its {kept} alone" in str(short.value)
    stopping = replace(problem, posture=Posture(at_rest=True), limits=limits, obstacles=())
    rates = np.append(0.1, np.zeros(robot.joints - 1))
    stopping = replace(stopping, start=replace(problem.start, joint_velocities=rates))
    require_time(replace(stopping, duration=0.5))
    with pytest.raises(NoPlanFound, match="rest within the limits of its acceleration") as error:
        require_time(replace(stopping, duration=0.49))
    assert error.value.status is Status.LIMIT_VIOLATED


@pytest.mark.parametrize("base", [Base.FREE_FLYER, Base.ATTITUDE_HELD])
@pytest.mark.parametrize("longest", [1e5, 1e7, 1e30])
def test_a_duration_too_long_to_foretell_the_motion_is_refused_at_once(
    lemur_capture: PlanningProblem, base: Base, longest: float
) -> None:
    """A search would integrate millions of steps, in many gigabytes."""
    start = replace(lemur_capture.start, angular_velocity_chaser_in_inertial=np.zeros(3))
    problem = replace(
        lemur_capture,
        robot=replace(lemur_capture.robot, base=base),
        start=replace(start, joint_velocities=np.full(7, 0.02)),
        obstacles=(),
        posture=Posture(at_rest=True),
    )
    for moving, goal in ((start, Posture(start.joint_positions, np.full(7, 0.02))), (None, None)):
        asked = problem if goal is None else replace(problem, start=moving, posture=goal)
        for lasts in (
            replace(asked, duration=longest),
            replace(asked, duration=longest, duration_range=DurationRange(5.0, longest)),
        ):
            with pytest.raises(InvalidInput, match="too far to be foretold; 1000 rad are") as no:
                perform(PlanningTask(lasts, SETTINGS))
            assert (no.value.status, no.value.field) == (Status.OUT_OF_RANGE, "duration")
