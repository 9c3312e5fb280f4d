"""Plans made before as first guesses: what is near, what it saves, and what it never costs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from robots import CANADARM2_SCENARIO, LEMUR_SCENARIO
from scipy.spatial.transform import Rotation
from shaped_problems import SOLIDS

from ff_planner_ros.cli import main
from ff_planner_ros.errors import InvalidInput, NoPlanFound
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.obstacles import Obstacle, RigidMotion
from ff_planner_ros.planning.problem.problem import Objective, PlanningProblem
from ff_planner_ros.planning.problem.settings import SearchDepth
from ff_planner_ros.planning.scenario.library_file import LIBRARY, load_library, save_library
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.library import Library, StoredPlan, kind_and_place
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.scenarios import scenario
from ff_planner_ros.robot.collision.solids import Solid

SETTINGS = replace(load_parameters().planner, search=SearchDepth.QUICK)
CAPTURE = load_scenario(LEMUR_SCENARIO)


def task(problem: PlanningProblem) -> PlanningTask:
    return PlanningTask(problem, SETTINGS)


def place(problem: PlanningProblem) -> np.ndarray:
    return kind_and_place(task(problem))[1]


def apart(one: PlanningProblem, other: PlanningProblem) -> float:
    return float(np.linalg.norm(place(one) - place(other)))


def drawn(seed: int, base: PlanningProblem = CAPTURE) -> PlanningProblem:
    """Return a problem of the region: the goal up to 3 cm away, each joint up to 0.05 rad."""
    rng = np.random.default_rng(seed)
    target, start = base.target, base.start
    joints = start.joint_positions + rng.uniform(-0.05, 0.05, len(start.joint_positions))
    return replace(
        base,
        target=replace(target, position=target.position + rng.uniform(-0.03, 0.03, 3)),
        start=replace(start, joint_positions=joints),
    )


def stored(problem: PlanningProblem, plan: Plan) -> StoredPlan:
    return StoredPlan(*kind_and_place(task(problem)), plan.coefficients)


@pytest.fixture(scope="module")
def library() -> Library:
    problems = [drawn(seed) for seed in range(6)]
    return Library(tuple(stored(one, perform(task(one))) for one in problems))


def test_distances_are_what_their_units_say() -> None:
    """Of a joint's angle, of a length over the arm's reach, of an angle, and of a rate times T."""
    chain = CAPTURE.robot.model
    offsets = [chain.jointPlacements[k].translation for k in range(3, 2 + CAPTURE.robot.joints)]
    offsets.append(chain.frames[CAPTURE.robot.tip_frame_id].placement.translation)
    reach = sum(float(np.sqrt(offset @ offset)) for offset in offsets)
    target = CAPTURE.target
    moved = replace(target, position=target.position + np.array([0.0, 0.3, 0.4]))
    assert apart(CAPTURE, replace(CAPTURE, target=moved)) == pytest.approx(0.5 / reach, rel=1e-4)
    turn = Rotation.from_rotvec([0.0, 0.006, 0.008]) * Rotation.from_quat(target.quaternion_xyzw)
    turned = replace(target, quaternion_xyzw=turn.as_quat())
    assert apart(CAPTURE, replace(CAPTURE, target=turned)) == pytest.approx(0.01, rel=1e-3)
    faster = replace(target, angular_velocity=target.angular_velocity + np.array([3e-3, 0.0, 4e-3]))
    expected = 5e-3 * CAPTURE.duration
    assert apart(CAPTURE, replace(CAPTURE, target=faster)) == pytest.approx(expected, rel=1e-6)
    first, *others = CAPTURE.obstacles
    larger = (replace(first, shape=Solid("sphere", [first.radius + 0.01])), *others)
    assert apart(CAPTURE, replace(CAPTURE, obstacles=larger)) == pytest.approx(0.01 / reach)


def test_bodies_are_as_far_as_they_moved_and_turned_and_of_another_kind_by_their_shapes() -> None:
    body = Obstacle("panel", SOLIDS["box"], RigidMotion(np.array([1.0, 2.0, 3.0])))

    def among(one: Obstacle) -> PlanningProblem:
        return replace(CAPTURE, obstacles=(*CAPTURE.obstacles, one))

    larger = replace(body, shape=SOLIDS["cone"])
    kinds = {kind_and_place(task(one))[0] for one in (CAPTURE, among(body), among(larger))}
    assert len(kinds) == 3
    turned = body.with_motion(quaternion_xyzw=Rotation.from_rotvec([0.0, 0.01, 0.0]).as_quat())
    assert apart(among(body), among(turned)) == pytest.approx(0.01, rel=1e-3)
    turning = body.with_motion(angular_velocity=np.array([0.0, 0.0, 1e-3]))
    expected = 1e-3 * CAPTURE.duration
    assert apart(among(body), among(turning)) == pytest.approx(expected, rel=1e-6)
    moved = [
        body.with_motion(position=body.motion.position + step)
        for step in np.diag([0.3, 0.6, 0.0])[:2]
    ]
    near, far = (apart(among(body), among(one)) for one in moved)
    assert far == pytest.approx(2.0 * near)
    assert near > 0.0


@pytest.mark.parametrize("kind", ["ordinary", "cluttered"])
def test_a_problem_lies_at_the_same_place_in_every_inertial_frame(kind: str) -> None:
    here, there = (scenario(kind, "lemur", 3, turned=turned).problem for turned in (False, True))
    assert kind_and_place(task(here))[0] == kind_and_place(task(there))[0]
    assert apart(here, there) < 1e-4


def test_another_robot_objective_or_number_of_obstacles_is_another_kind() -> None:
    kinds = {
        kind_and_place(task(one))[0]
        for one in (
            CAPTURE,
            replace(CAPTURE, objective=Objective(0.0, 1.0)),
            replace(CAPTURE, obstacles=CAPTURE.obstacles[1:]),
            load_scenario(CANADARM2_SCENARIO),
        )
    }
    assert len(kinds) == 4
    assert kind_and_place(task(drawn(0)))[0] in kinds


def test_the_nearest_plan_is_the_guess_and_one_that_is_far_is_none(library: Library) -> None:
    places = [one.place for one in library.plans]
    for seed in range(100, 120):
        asked = task(drawn(seed))
        nearest = min(
            range(6), key=lambda k: float(np.linalg.norm(places[k] - place(asked.problem)))
        )
        guess = library.first_guess(asked)
        assert guess is not None
        assert guess.tobytes() == library.plans[nearest].coefficients.tobytes(), seed
    far = replace(CAPTURE, duration=4.0 * CAPTURE.duration)
    assert library.first_guess(task(far)) is None
    assert Library(()).first_guess(task(CAPTURE)) is None


@pytest.mark.ci
def test_in_its_region_a_library_shortens_the_search_and_costs_no_plan(times: Any) -> None:
    base = scenario("cluttered", "lemur", 3, turned=False).problem
    cold, warm, longer, made = [], [], [], list[StoredPlan]()
    for seed in range(times(8, 60)):
        asked = task(drawn(seed, base))
        try:
            alone = perform(asked)
        except (InvalidInput, NoPlanFound):  # the arm begins in an obstacle, or there is no way
            continue
        guess = Library(tuple(made)).first_guess(asked)
        if guess is not None:
            near = replace(asked, first_guess=guess)
            assert near.digest != asked.digest
            cold.append(alone.solver.rollouts)
            beside = perform(near)
            warm.append(beside.solver.rollouts)
            longer.append(beside.metrics.joint_path_length / alone.metrics.joint_path_length)
        if len(made) < 3:
            made.append(stored(asked.problem, alone))
    assert len(cold) >= 4
    assert np.median(warm) <= 2 / 3 * np.median(cold), (cold, warm)
    # A neighbour's way around many obstacles, only mended, would be longer by three quarters.
    assert np.median(longer) <= 1.01, longer


@pytest.mark.ci
def test_a_library_shortens_the_search_for_the_least_attitude() -> None:
    """And what is found is no worse than the plan of the least joint path."""
    base = replace(
        scenario("ordinary", "lemur", 4, turned=False).problem, objective=Objective(0.0, 1.0)
    )
    made = Library((stored(base, perform(task(base))),))
    beside = task(drawn(1, base))
    guess = made.first_guess(beside)
    assert guess is not None
    alone, near = perform(beside), perform(replace(beside, first_guess=guess))
    shortest = perform(task(replace(beside.problem, objective=Objective(1.0, 0.0))))
    assert near.solver.rollouts <= 0.5 * alone.solver.rollouts
    assert near.metrics.max_chaser_euler < shortest.metrics.max_chaser_euler


def test_a_file_holds_the_library_to_the_last_bit(library: Library, tmp_path: Path) -> None:
    other = StoredPlan("another robot", np.zeros(3), np.ones(36))
    for plans in ((), (other,), (*library.plans, other)):
        save_library(plans, tmp_path)
        again = load_library(tmp_path).plans
        assert [one.kind for one in again] == [one.kind for one in plans]
        for name in ("place", "coefficients"):
            pairs = zip(again, plans, strict=True)
            assert all(getattr(a, name).tobytes() == getattr(b, name).tobytes() for a, b in pairs)
    assert sorted(path.name for path in tmp_path.iterdir()) == [LIBRARY]


def test_a_file_that_is_no_library_is_named(library: Library, tmp_path: Path) -> None:
    whole = save_library(library.plans, tmp_path / "whole").read_bytes()
    for content in (None, b"", b"no archive", whole[: len(whole) // 2], whole[:-1]):
        if content is not None:
            (tmp_path / LIBRARY).write_bytes(content)
        with pytest.raises(InvalidInput, match=r"library is .*library\.npz: no library can be"):
            load_library(tmp_path)
    np.savez(tmp_path / "other.npz", version=np.array(99))
    (tmp_path / "other.npz").rename(tmp_path / LIBRARY)
    with pytest.raises(InvalidInput, match="of version 99"):
        load_library(tmp_path)


@pytest.mark.parametrize("number", [np.nan, np.inf, 1e308, -1.1e100])
@pytest.mark.parametrize("name", ["place", "coefficients"])
def test_numbers_of_a_library_that_no_task_takes_are_those_of_the_library(
    name: str, number: float, tmp_path: Path
) -> None:
    """They were refused as `first_guess`, which nobody had given."""
    plan = replace(StoredPlan("kind", np.zeros(3), np.ones(36)), **{name: np.array([0.0, number])})
    save_library([plan], tmp_path)
    with pytest.raises(InvalidInput, match=rf"--library is .*its {name}s? are no list of numbers"):
        load_library(tmp_path, "--library")


def test_the_command_plans_from_the_nearest_plan(
    library: Library, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_library(library.plans, tmp_path)
    answers = [tmp_path / name for name in ("cold.json", "warm.json", "again.json")]
    words = ["plan", str(LEMUR_SCENARIO), "--json"]
    assert main([*words, str(answers[0])]) == 0
    for answer in answers[1:]:
        assert main([*words, str(answer), "--library", str(tmp_path)]) == 0
    digests = [line for line in capsys.readouterr().out.splitlines() if "digest" in line]
    assert digests[0] != digests[1] == digests[2]
    assert main([*words, str(answers[0]), "--library", str(tmp_path / "none")]) == 2
    assert "--library is" in capsys.readouterr().err
