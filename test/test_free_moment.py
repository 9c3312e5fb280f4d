"""The planner chooses the duration: against fixed durations, other frames and differences."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from judging import violations
from robots import LEMUR_SCENARIO
from test_any_frame import FRAMES
from test_tumbling import seen_from

from ff_planner_benchmark.problems import tumbling
from ff_planner_ros.analysis.plan_document import planned_scene
from ff_planner_ros.analysis.plan_json import plan_dictionary
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import EndedBy, InvalidInput, NoPlanFound, OutOfTime, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.system_frame import in_own_frame
from ff_planner_ros.planning.motion.watch import Watch
from ff_planner_ros.planning.optimisation.evaluated_path import PathLinearisation
from ff_planner_ros.planning.optimisation.free_program import FreeProgram
from ff_planner_ros.planning.optimisation.program import path_program
from ff_planner_ros.planning.paths.end_effector_polynomial import end_effector_paths
from ff_planner_ros.planning.paths.joint_spline import joint_splines
from ff_planner_ros.planning.paths.path_family import PathFamily
from ff_planner_ros.planning.problem.approach import Approach
from ff_planner_ros.planning.problem.camera import Camera
from ff_planner_ros.planning.problem.problem import (
    DurationRange,
    Limits,
    Objective,
    Obstacle,
    Parametrisation,
    PlanningProblem,
    lasting,
)
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.search.planner import NOBODY
from ff_planner_ros.planning.search.planner import plan as planner
from ff_planner_ros.planning.task import task as task_module
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.robots import ROBOTS, bench_robot
from ff_planner_ros.robot.collision.geometry import Geometry

SETTINGS = load_parameters().planner
# What takes long is tried with fewer first guesses, here and there.
QUICK = replace(SETTINGS, starts=3)
FASTEST = Objective(0.0, 0.0, duration=1.0)
FAMILIES: dict[str, Callable[[PlanningProblem], PathFamily]] = {
    "paper's": end_effector_paths,
    "splines": lambda problem: joint_splines(problem, SETTINGS),
}


def free(
    problem: PlanningProblem, shortest: float, longest: float, objective: Objective = FASTEST
) -> PlanningProblem:
    """A problem of which the planner chooses the duration."""
    return replace(
        problem,
        duration=longest,
        target=problem.target
        if problem.target_body is None
        else problem.target_body.target(longest),
        duration_range=DurationRange(shortest, longest),
        objective=objective,
    )


def moving_scene() -> PlanningProblem:
    """A body that tumbles, and a sphere that drifts towards the arm."""
    problem = tumbling.problem("tumbling", 0)
    drifting = Obstacle.sphere("drifting", [1.0, 0.4, 0.3], 0.2, [-0.03, 0.0, 0.01])
    return in_own_frame(replace(problem, obstacles=(*problem.obstacles, drifting)))


def with_all_limits() -> PlanningProblem:
    """A scene with a corridor, a camera, and limits of accelerations and of the chaser's angles."""
    given = moving_scene()
    limits = Limits(True, 0.3, joint_accelerations=(0.2,), chaser_rotation=0.3)
    camera = Camera(given.robot.tip_link, [0.05, 0.0, 0.02], [0.3, 0.0, 1.0], 0.5, 0.3)
    approach = Approach(np.array([0.0, 0.6, 0.8]), 0.4)
    return replace(given, limits=limits, approach=approach, camera=camera)


def with_bodies() -> PlanningProblem:
    """The same scene for a robot with shapes, some of them in a sphere that drifts."""
    given = moving_scene()
    robot = bench_robot(ROBOTS[0], Geometry.SHAPES)
    deep = Obstacle.sphere("deep", [1.0, 0.4, 0.3], 0.5, [-0.03, 0.0, 0.01])
    return replace(given, robot=robot, obstacles=(*given.obstacles, deep))


@pytest.mark.parametrize("objective", [FASTEST, Objective(1.0, 2.0, 0.3)], ids=["T", "all"])
@pytest.mark.parametrize("name", list(FAMILIES))
@pytest.mark.parametrize("scene", [moving_scene, with_all_limits, with_bodies])
def test_derivatives_by_the_duration_agree_with_differences_of_problems_made_anew(
    scene: Callable[[], PlanningProblem], name: str, objective: Objective
) -> None:
    given = scene()
    # A quarter of the way between fewer points, derivatives are those of parabolas; and GJK knows
    # the normals of distances to five digits, whatever they depend on.
    points, exact = 41, 2e-5 if given.robot.geometry is Geometry.SHAPES else 1e-7
    problem = free(given, 0.2 * given.duration, 2.0 * given.duration, objective)
    duration = 0.4 * given.duration

    def made_anew(duration: float) -> PathLinearisation:
        fixed = lasting(problem, duration)
        program = path_program(replace(fixed, objective=path), FAMILIES[name](fixed), SETTINGS)
        return replace(program, points=points).linearise(x)

    path = Objective(1.0, objective.chaser_attitude)
    fixed = lasting(problem, duration)
    family = FAMILIES[name](fixed)
    x = next(family.first_guesses((), points, 0.0)) + 0.02 * np.random.default_rng(1).normal(
        size=family.variables
    )
    program = replace(path_program(replace(fixed, objective=path), family, SETTINGS), points=points)
    unit = 3.0
    found = FreeProgram(problem, program, objective.duration, unit).linearise(
        np.append(x, duration / unit)
    )
    here = made_anew(duration)
    step = 5e-4 * duration  # where the nearest point of a link goes over its end, there is a kink
    sides = [made_anew(duration + k * step) for k in (-4, -2, -1, 1, 2, 4)]

    def slope(values: list[Array]) -> Array:
        """Central differences of the fourth order with two steps, extrapolated to none."""
        a, b, c, d, e, f = values
        fine = (b - 8.0 * c + 8.0 * d - e) / (12.0 * step)
        coarse = (a - 8.0 * b + 8.0 * e - f) / (24.0 * step)
        return (16.0 * fine - coarse) / 15.0 * unit

    def agree(told: Array, values: list[Array], what: str) -> None:
        wanted = slope(values)
        largest = 1.0 + np.abs(wanted).max(initial=0.0)
        assert np.abs(told - wanted).max(initial=0.0) < exact * largest, what

    agree(found.gradient[-1:], [np.array([side.value]) for side in sides], "objective")
    told = objective.duration * unit
    max_terms = [side.max_terms if side.max_terms.size else np.zeros(1) for side in sides]
    agree(found.max_terms_jacobian[:, -1] - told, max_terms, "max_terms")
    agree(found.equalities_jacobian[:, -1], [side.equalities for side in sides], "goal")
    common = here.names
    for side in sides:
        common = np.intersect1d(common, side.names)
    assert len(common) > 0.8 * len(here.names) > 100
    rows = [side.constraints[np.isin(side.names, common)] for side in sides]
    order = [np.argsort(side.names[np.isin(side.names, common)]) for side in sides]
    kept = np.isin(found.names, common)
    by_name = np.argsort(found.names[kept])
    agree(
        found.constraints_jacobian[kept, -1][by_name],
        [row[at] for row, at in zip(rows, order, strict=True)],
        "requirements",
    )
    # By the path, they are those of the program of the duration.
    by_x = found.constraints_jacobian[: len(here.names), :-1]
    # Of two edges that are nearly parallel, GJK's normal depends on the last digits.
    same = 1e-9 if given.robot.geometry is Geometry.LINES else 1e-3
    assert np.abs(by_x - here.constraints_jacobian).max() < same
    assert found.objective == pytest.approx(here.objective + objective.duration * duration)


@pytest.mark.parametrize("name", list(FAMILIES))
def test_motions_of_another_duration_are_those_of_the_problem_with_that_duration(
    name: str,
) -> None:
    given = moving_scene()
    problem = free(given, 1.0, 30.0)
    family = FAMILIES[name](lasting(problem, given.duration))
    x = 0.1 * np.random.default_rng(2).normal(size=family.variables)
    for duration in (0.7 * given.duration, 1.4 * given.duration):
        fixed = lasting(problem, duration)
        there, anew = (
            made.motion(x, 21) for made in (family.lasting(fixed), FAMILIES[name](fixed))
        )
        for quantity in ("q", "v", "q_half_way", "goal_error"):
            error = np.abs(getattr(there, quantity) - getattr(anew, quantity)).max(initial=0.0)
            assert error < 1e-9, (duration, quantity)


# Problems whose shortest capture along the paper's paths is well inside these ranges [s].
_NARROW = {1: (1.6, 2.2), 7: (2.9, 4.0)}


@pytest.mark.law("PLAN-31")
@pytest.mark.ci
def test_the_fastest_capture_is_as_fast_as_a_sweep_finds(times: Callable[[int, int], int]) -> None:
    at_night = times(0, 1) == 1
    for number in range(20) if at_night else _NARROW:
        given = tumbling.problem("tumbling", number)
        window = 0.1 * given.duration, 1.3 * given.duration
        if not at_night:
            window = _NARROW[number]
            given = replace(given, parametrisation=Parametrisation.END_EFFECTOR_POLYNOMIAL)
        problem = free(given, *window)
        made = perform(PlanningTask(problem, QUICK))
        chosen = made.duration
        assert chosen is not None
        assert window[0] <= chosen <= min(window[1], 1.02 * given.duration), number
        require_captured(given, made)
        for part in np.linspace(0.98, 0.8, times(2, 10)):
            if part * chosen > window[0]:
                assert not has_plan(lasting(problem, part * chosen)), (number, chosen, part)


@pytest.mark.law("PLAN-31")
def test_the_minimum_near_the_first_paths_is_not_the_end_of_the_search() -> None:
    """Of this problem it is at 5.0 s, and plans of 4.3 s are found by whoever asks for those."""
    given = tumbling.problem("tumbling", 3)
    problem = free(given, 0.1 * given.duration, 1.3 * given.duration)
    made = perform(PlanningTask(problem, QUICK))
    require_captured(given, made)
    assert made.duration is not None
    for part in (0.98, 0.85):
        assert not has_plan(lasting(problem, part * made.duration)), (made.duration, part)


def has_plan(problem: PlanningProblem) -> bool:
    try:
        perform(PlanningTask(problem, QUICK))
    except NoPlanFound:
        return False
    return True


def require_captured(given: PlanningProblem, made: Plan) -> None:
    """The plan passes the check at its own duration, which it ends with, at the body's grasp."""
    assert made.duration == made.trajectory.time[-1]
    assert given.target_body is not None
    target = given.target_body.target(made.duration)
    fixed = replace(given, duration=made.duration, target=target)
    assert not violations(fixed, made, SETTINGS)
    there = made.trajectory.ee_positions[-1]
    assert np.abs(there - target.position).max() < SETTINGS.position_tolerance
    speed = made.trajectory.ee_linear_velocities[-1] - target.linear_velocity
    assert np.abs(speed).max() < 1e-3


@pytest.fixture(scope="module")
def resting() -> PlanningProblem:
    return load_task(LEMUR_SCENARIO, Defaults(SETTINGS)).problem


@pytest.fixture(scope="module")
def chosen(resting: PlanningProblem) -> Plan:
    return perform(PlanningTask(free(resting, 5.0, 20.0, Objective(1.0, 0.0)), SETTINGS))


def test_where_the_joint_path_counts_no_duration_of_the_range_has_a_shorter_one(
    resting: PlanningProblem, chosen: Plan
) -> None:
    for duration in np.linspace(5.0, 20.0, 6):
        fixed = perform(PlanningTask(replace(resting, duration=duration), SETTINGS))
        assert chosen.metrics.joint_path_length <= 1.005 * fixed.metrics.joint_path_length, duration


def test_the_plan_is_the_one_that_is_made_if_its_duration_is_given(
    resting: PlanningProblem, chosen: Plan
) -> None:
    assert chosen.duration is not None
    fixed = replace(resting, duration=chosen.duration)
    assert not violations(fixed, chosen, SETTINGS)
    again = perform(PlanningTask(fixed, SETTINGS, first_guess=chosen.coefficients))
    for quantity in ("joint_positions", "joint_velocities", "chaser_positions"):
        there, here = getattr(again.trajectory, quantity), getattr(chosen.trajectory, quantity)
        assert np.abs(there - here).max() < 2e-2, quantity


def test_where_the_chaser_is_held_back_both_families_compete_for_a_free_duration(
    resting: PlanningProblem,
) -> None:
    """The paper's paths alone take twice as long a joint path."""
    limits = replace(resting.limits, chaser_attitude=np.deg2rad(8.0))
    problem = free(replace(resting, limits=limits), 10.0, 14.0, Objective(1.0, 0.0))
    papers = replace(problem, parametrisation=Parametrisation.END_EFFECTOR_POLYNOMIAL)
    made, alone = (perform(PlanningTask(one, SETTINGS)) for one in (problem, papers))
    assert made.family == Parametrisation.JOINT_SPLINE
    assert made.metrics.joint_path_length < 0.98 * alone.metrics.joint_path_length
    assert made.duration is not None
    assert not violations(lasting(problem, made.duration), made, SETTINGS)


@pytest.mark.ci
def test_the_refusal_of_a_range_says_what_is_hardest_to_meet(resting: PlanningProblem) -> None:
    """Not the obstacles, which candidates of some durations were clear of."""
    limits = replace(resting.limits, chaser_attitude=0.005)
    problem = free(replace(resting, limits=limits), 11.0, 13.0, Objective(1.0, 0.0))
    with pytest.raises(NoPlanFound, match=r"lasts 11, 11\.5, 12, 12\.5, 13 s") as refused:
        perform(PlanningTask(problem, replace(SETTINGS, starts=4)))
    assert refused.value.status is Status.LIMIT_VIOLATED
    assert "hardest to meet" in refused.value.constraint


def test_a_higher_weight_of_the_duration_never_makes_it_longer(resting: PlanningProblem) -> None:
    papers = replace(resting, parametrisation=Parametrisation.END_EFFECTOR_POLYNOMIAL)
    asked = [free(papers, 3.0, 15.0, Objective(1.0, 0.0, weight)) for weight in (0.0, 0.05, 1.0)]
    durations = [perform(PlanningTask(one, QUICK)).duration or 0.0 for one in asked]
    assert durations == sorted(durations, reverse=True)
    assert durations[0] > 1.2 * durations[-1]


@pytest.mark.parametrize("name", ["at 2 m/s", "7000 km away"])
def test_the_moment_does_not_depend_on_the_frame(
    name: str, resting: PlanningProblem, chosen: Plan
) -> None:
    frame = FRAMES[name]
    problem = free(resting, 5.0, 20.0, Objective(1.0, 0.0))
    there = frame.problem(replace(problem, duration_range=None))
    # What rests in one frame moves in the other.
    window = DurationRange(5.0, 20.0, frame.velocity)
    seen = perform(PlanningTask(replace(there, duration_range=window), SETTINGS))
    assert seen.duration == pytest.approx(chosen.duration, rel=1e-4)
    of_joints = seen.trajectory.joint_positions - chosen.trajectory.joint_positions
    assert np.abs(of_joints).max() < 1e-3


def test_neither_does_that_of_a_capture() -> None:
    given = tumbling.problem("tumbling", 1)
    problem = free(given, 5.0, 8.0)
    here = perform(PlanningTask(problem, QUICK))
    frame = FRAMES["at 2 m/s"]
    there = seen_from(replace(problem, duration_range=None), frame)
    seen = perform(PlanningTask(replace(there, duration_range=problem.duration_range), QUICK))
    assert seen.duration == pytest.approx(here.duration, rel=1e-4)


def test_a_range_of_one_moment_is_a_duration_that_is_given(resting: PlanningProblem) -> None:
    problem = in_own_frame(resting)
    window = DurationRange(resting.duration, resting.duration)
    fixed, of_range = (
        planner(one, SETTINGS) for one in (problem, replace(problem, duration_range=window))
    )
    assert of_range.duration == resting.duration
    assert (of_range.trajectory.joint_positions == fixed.trajectory.joint_positions).all()


def test_the_weight_of_a_duration_that_is_given_changes_no_plan(resting: PlanningProblem) -> None:
    problem = in_own_frame(resting)
    plans = [
        planner(replace(problem, objective=objective), SETTINGS).trajectory.joint_positions
        for objective in (Objective(1.0, 0.0), Objective(1.0, 0.0, 2.0), FASTEST)
    ]
    assert (plans[1] == plans[0]).all()
    assert (plans[2] == plans[0]).all()


def test_where_no_moment_has_a_plan_the_answer_says_why(resting: PlanningProblem) -> None:
    papers = replace(resting, parametrisation=Parametrisation.END_EFFECTOR_POLYNOMIAL)
    with pytest.raises(
        NoPlanFound, match=r"that lasts 0\.1, 0\.175, 0\.25, 0\.325, 0\.4 s"
    ) as refused:
        perform(PlanningTask(free(papers, 0.1, 0.4), replace(SETTINGS, starts=1)))
    assert refused.value.status is Status.TORQUE_TOO_HIGH


def test_the_search_for_a_moment_ends_when_its_time_is_over(resting: PlanningProblem) -> None:
    class Impatient(Watch):
        looks = 0

        def require_time(self, *_: str) -> None:
            self.looks += 1
            if self.looks > 5:
                raise OutOfTime("the time is over")

    with pytest.raises(NoPlanFound) as refused:
        perform(PlanningTask(free(resting, 5.0, 20.0), SETTINGS), Impatient())
    assert refused.value.status is Status.TIMED_OUT
    assert not isinstance(NOBODY, Impatient)


def test_a_search_that_is_ended_after_a_plan_was_made_answers_with_it(
    resting: PlanningProblem,
) -> None:
    class Impatient(Watch):
        found = False

        def require_time(self, *_: str) -> None:
            if self.found:
                raise OutOfTime("the time is over")

        def offer(self, _: Plan) -> None:
            self.found = True

    papers = replace(resting, parametrisation=Parametrisation.END_EFFECTOR_POLYNOMIAL)
    problem = free(papers, 3.0, 15.0, Objective(1.0, 0.0, 0.05))
    made = perform(PlanningTask(problem, QUICK), Impatient())
    assert made.solver.ended_by == EndedBy.DEADLINE
    assert made.duration is not None
    assert 3.0 <= made.duration <= 15.0
    assert not violations(lasting(problem, made.duration), made, QUICK)


def test_where_the_tail_of_the_chosen_duration_cannot_be_driven_the_next_one_is_taken(
    resting: PlanningProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = free(resting, 6.0, 12.0, Objective(1.0, 0.0))

    def choosing_8_s(
        problem: PlanningProblem, settings: PlannerSettings, watch: Watch, guess: Array | None
    ) -> Plan:
        return planner(lasting(problem, 8.0), settings, watch, guess)

    def drivable_from(shortest: float) -> Callable[..., Plan]:
        def with_tail(problem: PlanningProblem, plan: Plan, *_: object) -> Plan:
            if problem.duration < shortest:
                raise NoPlanFound(Status.LIMIT_VIOLATED, f"a tail after {problem.duration:g} s")
            return plan

        return with_tail

    for shortest, expected in ((0.0, 8.0), (8.1, 8.25), (8.5, 9.0)):
        monkeypatch.setattr(task_module, "with_tail", drivable_from(shortest))
        made = perform(PlanningTask(problem, QUICK), method=choosing_8_s)
        assert made.duration == expected
        assert not violations(lasting(problem, expected), made, QUICK)
    monkeypatch.setattr(task_module, "with_tail", drivable_from(np.inf))
    with pytest.raises(NoPlanFound, match="a tail after 8 s"):
        perform(PlanningTask(problem, QUICK), method=choosing_8_s)


def test_a_scenario_holds_a_range_and_a_weight_and_the_answer_says_what_was_chosen(
    tmp_path: Path, resting: PlanningProblem
) -> None:
    task = PlanningTask(free(resting, 8.0, 12.0, Objective(1.0, 0.0, 0.1)), SETTINGS)
    write_scenario(task, tmp_path / "free.yaml")
    read = load_task(tmp_path / "free.yaml", Defaults(SETTINGS))
    assert read.digest == task.digest
    document = yaml.safe_load((tmp_path / "free.yaml").read_text())
    assert document["duration"] == {"min": 8.0, "max": 12.0}
    assert document["objective"]["duration"] == 0.1
    others = [
        free(resting, 8.0, 12.0, Objective(1.0, 0.0)),
        free(resting, 8.0, 11.0, Objective(1.0, 0.0, 0.1)),
        replace(resting, duration=12.0),
    ]
    assert len({task.digest, *(PlanningTask(one, SETTINGS).digest for one in others)}) == 4
    made = perform(task)
    answer = plan_dictionary(made, task, 0.0)
    assert answer["duration"] == made.duration == answer["time"][-1]
    assert planned_scene(answer) is not None


@pytest.mark.parametrize(
    ("duration", "field"),
    [
        ({"min": 0.0, "max": 3.0}, "duration.min"),
        ({"min": 5.0, "max": 3.0}, "duration.max"),
        ({"min": 5.0}, "duration.max"),
        ({"min": 5.0, "max": float("inf")}, "duration.max"),
        ({"min": "soon", "max": 3.0}, "duration.min"),
        ({"min": 1.0, "max": 3.0, "wanted": 2.0}, "duration.wanted"),
        ([1.0, 3.0], "duration"),
    ],
)
def test_an_impossible_range_is_refused_by_name(
    duration: object, field: str, tmp_path: Path, resting: PlanningProblem
) -> None:
    file = tmp_path / "scenario.yaml"
    write_scenario(PlanningTask(resting, SETTINGS), file)
    document = yaml.safe_load(file.read_text()) | {"duration": duration}
    file.write_text(yaml.safe_dump(document))
    with pytest.raises(InvalidInput) as refused:
        load_task(file, Defaults(SETTINGS))
    assert refused.value.field == field
