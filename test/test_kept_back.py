"""What a robust plan keeps back, and its refusals, with margins and plans of our own choice."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from core_rows import distances_of_core
from near_bodies import bounds_from, distances_from
from robots import CONFIG, LEMUR_SCENARIO
from scipy.spatial.transform import Rotation
from scipy.stats import norm
from shaped_problems import SOLIDS
from straight_arms import ball, straight_arm

from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.distance.bodies import placed_bodies
from ff_planner_ros.planning.motion.plan import Plan, Trajectory
from ff_planner_ros.planning.motion.system_frame import in_own_frame
from ff_planner_ros.planning.problem.approach import Approach
from ff_planner_ros.planning.problem.problem import (
    Limits,
    Obstacle,
    PlanningProblem,
    RigidMotion,
    with_capture_target,
)
from ff_planner_ros.planning.problem.settings import USUAL_SIGMAS, RobustSettings
from ff_planner_ros.planning.problem.target_body import AttachedObstacle
from ff_planner_ros.planning.robust import robust
from ff_planner_ros.planning.robust.margins import (
    ATTITUDE,
    CLEARANCE,
    CORRIDOR,
    ROTATION,
    TORQUE,
    Margins,
)
from ff_planner_ros.planning.scenario.scenario import Defaults, load_scenario, load_task
from ff_planner_ros.planning.search.planner import NOBODY
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.collision.solids import Solid

WALL = '<collision><geometry><box size="0.4 0.5 0.6"/></geometry></collision>'
SIGMAS = 3.0
PLAIN = load_parameters().planner
SETTINGS = replace(PLAIN, robust=replace(PLAIN.robust, sigmas=SIGMAS))


def margins(kind: str, *rows: tuple[float, float, int, float]) -> Margins:
    """Of each row the value, the deviation, what it is of, and when."""
    values, deviations, which, times = (np.array(column) for column in zip(*rows, strict=True))
    return Margins(kind, values, deviations[:, None], which.astype(int), times)


ENOUGH = margins(ATTITUDE, (2.0, 1e-3, 0, 1.0), (1.0, 1e-3, 1, 2.0))


class Asked:
    """Plans whose margins are told one round after the other; what was asked for is kept."""

    def __init__(
        self, patch: pytest.MonkeyPatch, plan: Plan, rounds: Sequence[Sequence[Margins]]
    ) -> None:
        self.plan, self.problems = plan, list[PlanningProblem]()
        self._rounds = [list(one) for one in rounds]
        patch.setattr(robust, "_margins", lambda *_: self._rounds[min(self.made, len(rounds)) - 1])

    @property
    def made(self) -> int:
        return len(self.problems)

    def method(self, problem: PlanningProblem, *_: Any) -> Plan:
        self.problems.append(problem)
        return self.plan

    def answer(self, problem: PlanningProblem) -> Plan:
        return robust.robust_plan(problem, SETTINGS, NOBODY, None, self.method, lambda plan: plan)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch, lemur_plan: Plan) -> Callable[..., Asked]:
    return lambda *rounds: Asked(monkeypatch, lemur_plan, rounds)


@pytest.fixture
def problem(lemur_capture: PlanningProblem) -> PlanningProblem:
    """With limits of everything, and a start that is far from them."""
    return replace(
        lemur_capture,
        robot=replace(lemur_capture.robot, effort_limits=np.full(7, 20.0)),
        limits=Limits(chaser_attitude=0.8, chaser_rotation=0.9, joint_torques=True),
        approach=Approach(np.array([0.0, 0.0, 1.0]), 0.05, 0.5),
    )


def test_what_lacks_something_is_kept_back_by_its_deviations_and_nothing_else_is(
    asked: Callable[..., Asked], problem: PlanningProblem
) -> None:
    """A little more than so many, of the worst row of each; what keeps enough stays."""
    lacking = [
        margins(CLEARANCE, (0.02, 0.01, 1, 2.0), (0.05, 0.02, 1, 3.0), (0.5, 0.03, 0, 3.0)),
        margins(ATTITUDE, (0.01, 0.02, 0, 4.0), (0.9, 0.2, 1, 4.0)),
        margins(ROTATION, (0.01, 0.03, 0, 4.0), (0.9, 0.2, 0, 4.5)),
        margins(TORQUE, (0.1, 0.2, 6, 5.0), (9.0, 0.4, 2, 5.0)),
    ]
    planner = asked(lacking, [ENOUGH])
    found = planner.answer(problem)
    first, second = planner.problems
    assert first is problem
    more = 1.02 * SIGMAS
    grown = [b.radius - a.radius for a, b in zip(problem.obstacles, second.obstacles, strict=True)]
    np.testing.assert_allclose(grown, [0.0, more * 0.02, 0.0], atol=1e-12)
    assert second.limits.chaser_attitude == pytest.approx(0.8 - more * 0.02)
    assert second.limits.chaser_rotation == pytest.approx(0.9 - more * 0.03)
    efforts = np.full(7, 20.0)
    efforts[6] -= more * 0.2
    np.testing.assert_allclose(second.robot.effort_limits, efforts)
    assert second.approach is problem.approach
    told = found.robust
    assert told is not None
    assert (told.rounds, told.sigmas) == (1, SIGMAS)
    assert dict(told.clearance) == {problem.obstacles[1].id: pytest.approx(more * 0.02)}
    assert told.chaser_attitude == pytest.approx(more * 0.02)
    assert told.chaser_rotation == pytest.approx(more * 0.03)
    assert dict(told.torques) == {problem.robot.joint_names[6]: pytest.approx(more * 0.2)}
    assert told.plain_joint_path_length == planner.plan.metrics.joint_path_length
    assert told.least_sigmas == pytest.approx(1000.0)


def test_what_is_fixed_to_a_target_grows_with_it_in_any_frame(
    asked: Callable[..., Asked],
) -> None:
    """The planner sees it in a frame of its own, where what is fixed is made anew."""
    lemur_tumbling = load_scenario(CONFIG / "scenarios/lemur_tumbling.yaml")
    assert lemur_tumbling.target_body is not None
    box = AttachedObstacle(
        "box", Solid("box", np.array([0.2, 0.3, 0.4])), np.array([0.0, 0.0, 3.0])
    )
    ball = AttachedObstacle.sphere("ball", np.array([0.0, 0.0, -3.0]), 0.2)
    body = replace(lemur_tumbling.target_body, obstacles=(box, ball))
    problem = with_capture_target(body, lemur_tumbling)
    names = [one.id for one in problem.obstacles]
    rows = [(0.02, 0.01, names.index("box"), 2.0), (0.02, 0.02, names.index("ball"), 2.0)]
    planner = asked([margins(CLEARANCE, *rows)], [ENOUGH])
    told = planner.answer(problem).robust
    assert told is not None
    assert dict(told.clearance) == pytest.approx(
        {"box": 1.02 * SIGMAS * 0.01, "ball": 1.02 * SIGMAS * 0.02}
    )
    second = in_own_frame(planner.problems[1])
    of_box, of_ball = (
        next(one for one in second.obstacles if one.id == name) for name in ("box", "ball")
    )
    assert not of_box.is_sphere
    assert of_ball.is_sphere
    assert of_ball.radius == pytest.approx(0.2 + told.clearance[names.index("ball")][1])
    assert of_box.solid.grown == pytest.approx(1.02 * SIGMAS * 0.01)


@pytest.mark.parametrize("kind", list(SOLIDS))
def test_a_solid_that_is_grown_is_all_that_is_within_a_distance_of_it(kind: str) -> None:
    """Its distances are less by that, by the core, by Coal and between spheres."""
    rng, solid, amount = np.random.default_rng(0), SOLIDS[kind], 0.07
    grown = replace(solid, grown=amount)
    assert grown.radius == pytest.approx(solid.radius + amount)
    assert grown.reach == pytest.approx(solid.reach + amount)
    ways = rng.normal(size=(50, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    np.testing.assert_allclose(grown.furthest(ways), solid.furthest(ways) + amount, atol=1e-12)
    arm = straight_arm(0.4, 1.0, solids=(("link_1", ball(0.05, 1.0)), ("chaser", WALL)))
    robots = (arm, with_bodies(straight_arm(0.4, 1.0)))
    for robot, _ in itertools.product(robots, range(50)):
        place = np.array([0.9, 0.0, 0.0]) + 1.2 * rng.normal(size=3)
        turn = Rotation.random(random_state=rng).as_quat()
        q = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, rng.normal()]])
        least = list[float]()
        for one in (
            Obstacle(kind, solid, RigidMotion(place, turn)),
            Obstacle(kind, grown, RigidMotion(place, turn)),
        ):
            count = len(robot.bodies)
            placed, none = placed_bodies(robot, q[:, 7:]), np.zeros(count, np.intp)
            rows = none, np.arange(count), none
            of_coal = distances_from(robot, placed, q, np.zeros(1), [one], rows).distance
            interest = float(of_coal.max()) + 1e-3  # so much that none may be left out
            of_core = distances_of_core(robot, q, np.zeros(1), [one], interest).values
            np.testing.assert_allclose(of_core, of_coal, atol=1e-6)
            bounds = bounds_from(robot, placed, q, np.zeros(1), [one])[0, :, 0]
            assert (bounds <= of_coal + 1e-9).all()
            least.append(of_coal)
        np.testing.assert_allclose(least[1], least[0] - amount, atol=2e-6)


def test_a_corridor_is_kept_as_surely_to_all_sides_as_a_limit_to_one(
    asked: Callable[..., Asked], problem: PlanningProblem
) -> None:
    """In a plane an error is beyond c deviations with the chance exp(-c^2 / 2)."""
    wide = np.sqrt(-2.0 * np.log(norm.sf(SIGMAS)))
    assert wide > SIGMAS
    narrow = margins(CORRIDOR, (1e-4, 1e-4, 0, 9.0))
    planner = asked([narrow], [ENOUGH])
    told = planner.answer(problem).robust
    assert told is not None
    assert told.corridor == pytest.approx(1.02 * wide * 1e-4)
    approach, kept = problem.approach, planner.problems[1].approach
    assert approach is not None
    assert kept is not None
    places = np.array([[0.0, 0.0, -0.03], [0.01, 0.0, -0.03], [0.0, 0.0, 0.0]])
    less = approach.margins(places).values - kept.margins(places).values
    np.testing.assert_allclose(less, told.corridor, atol=1e-12)
    # What keeps this chance lacks nothing.
    enough = margins(CORRIDOR, (1.001 * wide * 1e-4, 1e-4, 0, 9.0))
    assert asked([enough]).answer(problem).robust is not None
    assert margins(CORRIDOR, (3.01e-4, 1e-4, 0, 9.0)).lacking(SIGMAS).size == 1


def test_a_margin_that_keeps_its_deviations_lacks_nothing_and_one_that_does_not_does() -> None:
    rows = [(part * SIGMAS * 0.02, 0.02, 0, 1.0) for part in (1.0, 0.9995, 0.998, 0.34, -1.0)]
    assert margins(CLEARANCE, *rows).lacking(SIGMAS).tolist() == [2, 3, 4]


def test_a_scenario_that_does_not_say_how_much_keeps_back_what_the_parameters_do(
    tmp_path: Path,
) -> None:
    """Or the usual, where these keep back nothing."""
    scenario = tmp_path / "scenario.yaml"
    text = LEMUR_SCENARIO.read_text().replace(
        "../robots", str(LEMUR_SCENARIO.parents[1] / "robots")
    )

    def read(told: str, of_parameters: RobustSettings) -> RobustSettings:
        scenario.write_text(f"{text}\nplanner: {{robust: {told}}}\n")
        settings = replace(PLAIN, robust=of_parameters)
        return load_task(scenario, Defaults(settings)).settings.robust

    for of_parameters, kept in ((5.0, 5.0), (0.0, USUAL_SIGMAS)):
        defaults = replace(PLAIN.robust, sigmas=of_parameters)
        assert read("{mass: 0.02}", defaults) == replace(defaults, sigmas=kept, mass=0.02)
        assert read("{sigmas: 2.0}", defaults) == replace(defaults, sigmas=2.0)


def test_an_obstacle_grows_up_to_the_robot_at_its_start_and_no_further(
    asked: Callable[..., Asked], lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    beside = lemur_plan.trajectory.ee_positions[0] + [0.3, 0.0, 0.0]
    near = Obstacle.sphere("near", beside, 0.29)
    planner = asked([margins(CLEARANCE, (-0.2, 0.1, 0, 2.0))], [ENOUGH])
    planner.answer(replace(lemur_capture, obstacles=(near,)))
    (grown,) = planner.problems[1].obstacles
    assert near.radius < grown.radius <= 0.3 - 0.99e-4


@pytest.mark.parametrize("kind", [ATTITUDE, CORRIDOR, TORQUE])
def test_what_would_keep_back_all_that_there_is_is_refused_at_once(
    asked: Callable[..., Asked], problem: PlanningProblem, kind: str
) -> None:
    planner = asked([margins(kind, (0.01, 1e3, 0, 2.0))])
    with pytest.raises(NoPlanFound, match=r"fewer planner\.robust\.sigmas") as refused:
        planner.answer(problem)
    assert planner.made == 1
    status = Status.TORQUE_TOO_HIGH if kind == TORQUE else Status.LIMIT_VIOLATED
    assert refused.value.status is status
    # It tells what is lacking, and of no limit below zero that nobody asked for.
    assert "it must be" not in str(refused.value)


def test_a_refusal_names_what_keeps_least_when_and_how_much_of_it(
    asked: Callable[..., Asked], problem: PlanningProblem
) -> None:
    name, joint = problem.obstacles[2].id, problem.robot.joint_names[4]
    clear = margins(CLEARANCE, (0.05, 0.05, 1, 2.0), (0.02, 0.04, 2, 3.25), (0.9, 0.04, 0, 3.0))
    torque = margins(TORQUE, (0.8, 0.4, 4, 5.0))
    for lacking, words in (
        ([clear, torque], (name, "t = 3.25 s, 0.50 of its deviations, and 3 are to be kept")),
        ([torque], (joint, "t = 5.00 s, 2.00 of its deviations")),
        ([margins(CLEARANCE, (0.02, 0.04, 2, 11.5))], ("t = 11.50 s, after the goal, 0.50",)),
    ):
        with pytest.raises(NoPlanFound) as refused:
            asked(lacking).answer(problem)
        for word in words:
            assert word in str(refused.value), str(refused.value)


def test_a_refusal_tells_how_many_deviations_can_be_kept(
    asked: Callable[..., Asked], problem: PlanningProblem
) -> None:
    """By halving three times, from below: what is told can be kept."""
    for keeps, words in ((1.6, "1.5 can be kept"), (0.9, "0.75 can be kept"), (2.9, "2.625 can")):
        planner = asked([margins(TORQUE, (keeps * 0.1, 0.1, 3, 5.0))])
        planner.plan = replace(planner.plan, coefficients=np.empty(0))
        with pytest.raises(NoPlanFound, match=words):
            planner.answer(problem)
    with pytest.raises(NoPlanFound, match=r"not even 0\.375 can be kept"):
        asked([margins(TORQUE, (0.01, 0.1, 3, 5.0))]).answer(problem)


def test_margins_are_those_of_the_plan_with_its_tail_if_that_can_be_driven(
    lemur_capture: PlanningProblem, lemur_plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Seen(Exception):
        """Of a motion whose margins are asked for."""

    def tracked(_: Any, motion: Trajectory) -> None:
        raise Seen(motion)

    def undrivable(_: Plan) -> Plan:
        raise NoPlanFound(Status.SINGULAR, "a tail that is refused afterwards")

    monkeypatch.setattr(robust, "tracked_motion", tracked)
    longer = replace(lemur_plan, trajectory=replace(lemur_plan.trajectory))
    for whole, seen in ((lambda _: longer, longer), (undrivable, lemur_plan)):
        asked: Any = SimpleNamespace(problem=lemur_capture, settings=SETTINGS, whole=whole)
        with pytest.raises(Seen) as found:
            robust._margins(asked, lemur_plan)
        assert found.value.args[0] is seen.trajectory
