"""The corridor of the last stretch: plans against its geometry, written out, at dense times."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import yaml
from core_rows import sensitivity_of
from dense_motion import arms, truth
from judging import violations
from reference_program import rows_of
from robots import LEMUR_SCENARIO
from scipy.spatial.transform import Rotation
from test_any_frame import FRAMES
from test_tumbling import moved

from ff_planner_ros.analysis.drawing.surroundings import drawn_constraints
from ff_planner_ros.analysis.plan_json import plan_dictionary
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.distance.grasp_seen import GraspSeen
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.system_frame import in_own_frame
from ff_planner_ros.planning.paths.end_effector_polynomial import end_effector_paths
from ff_planner_ros.planning.paths.joint_spline import joint_splines
from ff_planner_ros.planning.paths.path_family import PathFamily
from ff_planner_ros.planning.problem.approach import HALF_ANGLE, RADIUS_AT_GRASP, Approach
from ff_planner_ros.planning.problem.problem import (
    DurationRange,
    Objective,
    Orientation,
    Parametrisation,
    PlanningProblem,
    lasting,
)
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.requirements.approach import ApproachCorridor
from ff_planner_ros.planning.requirements.requirement import Rows
from ff_planner_ros.planning.scenario.scenario import Defaults, load_scenario, load_task
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform

SETTINGS = load_parameters().planner
TUMBLING = load_scenario(LEMUR_SCENARIO.with_name("lemur_tumbling.yaml"))
RESTING = load_scenario(LEMUR_SCENARIO)
FAMILIES: dict[str, Callable[[PlanningProblem], PathFamily]] = {
    "paper's": end_effector_paths,
    "splines": lambda problem: joint_splines(problem, SETTINGS),
}
# From a side from which neither of the plans without an approach comes.
FORWARD, SIDEWAYS = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])


def with_approach(
    problem: PlanningProblem,
    direction: Array,
    distance: float = 0.15,
    half_angle: float = HALF_ANGLE,
) -> PlanningProblem:
    return replace(problem, approach=Approach(direction, distance, half_angle))


def seen_from_grasp(problem: PlanningProblem, plan: Plan) -> tuple[Array, Array]:
    """Times, and where the end effector is in the grasp's frame, twenty times a point or more.

    Joints, momentum and Euler's equations are integrated anew; nothing here is the planner's.
    """
    problem = lasting(problem, plan.duration)
    found = truth(problem, plan.trajectory)
    points = arms(problem.robot, found.q)[0][:, -1]
    body, target = problem.target_body, problem.target
    if body is None:
        later = found.time - problem.duration
        turned = Rotation.from_rotvec(np.outer(later, target.angular_velocity))
        attitudes = turned * Rotation.from_quat(target.quaternion_xyzw.copy())
        grasp_points = target.position + np.outer(later, target.linear_velocity)
        return found.time, attitudes.inv().apply(points - grasp_points)
    centers, attitudes, _ = moved(body, found.time)
    in_body = attitudes.inv().apply(points - centers)
    grasp = Rotation.from_quat(body.grasp_quaternion_xyzw.copy())
    return found.time, grasp.inv().apply(in_body - body.grasp_position)


def degrees_off(approach: Approach, places: Array) -> Array:
    """The angle between the line to the apex and the direction, by its cosine."""
    apex = approach.direction * RADIUS_AT_GRASP / math.tan(approach.half_angle)
    to_apex = apex - places
    cosine = to_apex @ approach.direction / np.linalg.norm(to_apex, axis=1)
    return np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)))


def outside(approach: Approach, places: Array) -> Array:
    """Whether places are near the grasp and not in the corridor, but for a micrometre."""
    near = np.linalg.norm(places, axis=1) < approach.distance - 1e-6
    beside = degrees_off(approach, places) > math.degrees(approach.half_angle)
    lateral = np.linalg.norm(np.cross(places, approach.direction), axis=1)
    width = RADIUS_AT_GRASP - places @ approach.direction * math.tan(approach.half_angle)
    return np.asarray(near & beside & (lateral > width + 1e-6))


def require_kept(problem: PlanningProblem, plan: Plan) -> None:
    approach = problem.approach
    assert approach is not None
    times, places = seen_from_grasp(problem, plan)
    bad = outside(approach, places)
    assert not bad.any(), (times[bad], places[bad], degrees_off(approach, places[bad]))
    # It came from far, and the last stretch is one.
    assert np.linalg.norm(places[0]) > approach.distance
    assert np.linalg.norm(places[-1]) < 1e-3


def test_margins_tell_inside_from_outside_and_change_by_no_more_than_the_place() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        approach = Approach(rng.normal(size=3), rng.uniform(0.02, 0.5), rng.uniform(0.02, 1.5))
        places = rng.normal(scale=approach.distance, size=(200, 3))
        found = approach.margins(places)
        assert ((found.values < -1e-6) <= outside(approach, places)).all()
        assert (outside(approach, places) <= (found.values < 0.0)).all()
        others = places + rng.normal(scale=0.1 * approach.distance, size=places.shape)
        change = np.abs(approach.margins(others).values - found.values)
        assert (change <= np.linalg.norm(others - places, axis=1) + 1e-12).all()
        told = np.rad2deg(approach.angles(places))
        assert told == pytest.approx(degrees_off(approach, places), abs=1e-4)


def test_planes_touch_the_cone_and_the_first_is_the_nearest() -> None:
    """The way to a cone's wall is concave: planes that touch it are never below it."""
    rng = np.random.default_rng(3)
    approach = Approach(rng.normal(size=3), 0.2, 0.4)

    def inside(places: Array) -> Array:
        along = -(places @ approach.direction)
        aside = np.linalg.norm(np.cross(places, approach.direction), axis=1)
        return np.asarray((RADIUS_AT_GRASP - aside) * np.cos(0.4) + along * np.sin(0.4))

    places, others = rng.normal(scale=0.2, size=(2, 100, 3))
    values, gradients = approach.planes(places)
    assert values[:, 0] == pytest.approx(inside(places), abs=1e-12)
    assert (values >= values[:, :1] - 1e-12).all()
    there = values[:, None] + np.einsum("tpi,toi->top", gradients, others - places[:, None])
    assert (there.min(axis=2) >= inside(others) - 1e-12).all()
    # Between two of the planes it is nearer by less than a hundredth of the way aside.
    aside = np.linalg.norm(np.cross(others, approach.direction), axis=1)
    assert (there.min(axis=2) <= inside(others) + 0.01 * aside).all()
    # On the axis no side is the nearest.
    axis = -0.1 * approach.direction[None]
    same, _ = approach.planes(axis)
    assert same == pytest.approx(np.full((1, values.shape[1]), inside(axis)[0]), abs=1e-12)


def test_gradients_of_margins_agree_with_differences() -> None:
    rng = np.random.default_rng(2)
    approach = Approach(rng.normal(size=3), 0.2, 0.4)
    places = rng.normal(scale=0.2, size=(300, 3))
    found, step = approach.margins(places), 1e-6
    for axis in np.eye(3):
        sides = [approach.margins(places + k * step * axis) for k in (-1.0, 1.0)]
        smooth = (sides[0].by_cone == found.by_cone) & (sides[1].by_cone == found.by_cone)
        slope = (sides[1].values - sides[0].values) / (2 * step)
        assert smooth.sum() > 290
        assert (found.gradients @ axis)[smooth] == pytest.approx(slope[smooth], abs=1e-6)


@pytest.mark.parametrize("scene", [TUMBLING, RESTING], ids=["tumbling", "resting"])
def test_the_grasp_sees_points_move_as_their_places_change(scene: PlanningProblem) -> None:
    turning = replace(scene.target, angular_velocity=np.array([0.2, -0.1, 0.3]))
    problem = replace(scene, target=turning)
    rng = np.random.default_rng(4)
    point, velocity = rng.normal(size=(2, 3))
    times, step = np.linspace(1.0, 9.0, 7), 1e-4

    def place(later: float) -> Array:
        points = point + np.outer(times + later, velocity)
        return GraspSeen(problem, times + later).sees(points)

    seen = GraspSeen(problem, times).sees_moving(
        point + np.outer(times, velocity), np.tile(velocity, (7, 1))
    )
    assert seen == pytest.approx((place(step) - place(-step)) / (2 * step), abs=1e-7)


@pytest.mark.parametrize("name", list(FAMILIES))
@pytest.mark.parametrize("scene", [TUMBLING, RESTING], ids=["tumbling", "resting"])
def test_derivatives_of_the_rows_agree_with_differences(name: str, scene: PlanningProblem) -> None:
    """With a target that moves in the frame of the plan, and turns."""
    problem = in_own_frame(with_approach(scene, FORWARD + SIDEWAYS, 0.4, 0.5))
    if problem.target_body is None:
        turning = replace(problem.target, angular_velocity=np.array([0.02, -0.01, 0.03]))
        problem = replace(problem, target=turning)
    family, required = FAMILIES[name](problem), ApproachCorridor()
    rng = np.random.default_rng(3)
    x = next(family.first_guesses((), 25, 0.0)) + 0.02 * rng.normal(size=family.variables)

    def rows(x: Array) -> Rows:
        motion = family.motion(x, 25)
        found = rows_of(required, problem, motion, sensitivity_of(family, motion), 0.01)
        assert found is not None
        return found

    def values(x: Array) -> dict[int, float]:
        return dict(zip(rows(x).names.tolist(), rows(x).values.tolist(), strict=True))

    here = rows(x)
    names = here.names.tolist()
    assert len(set(names)) == len(names) > 10
    assert {name % 2 for name in names} == {0, 1}  # the distance counts for some, else the cone
    for _ in range(5):
        way = rng.normal(size=family.variables)
        step = 1e-6 / np.linalg.norm(way)
        before, after = values(x - step * way), values(x + step * way)
        known = [k for k, name in enumerate(names) if name in before and name in after]
        assert len(known) > 0.9 * len(names)
        slope = np.array([after[names[k]] - before[names[k]] for k in known]) / (2 * step)
        told = (here.jacobian @ way)[known]
        assert told == pytest.approx(slope, abs=2e-6 * np.abs(slope).max())


@pytest.mark.law("PLAN-13")
@pytest.mark.parametrize("points", [50, pytest.param(13, marks=pytest.mark.ci)])
@pytest.mark.parametrize("family", ["end_effector_polynomial", "joint_spline"])
@pytest.mark.parametrize(
    ("scene", "direction"), [(TUMBLING, SIDEWAYS), (RESTING, SIDEWAYS)], ids=["tumbling", "resting"]
)
def test_the_end_effector_comes_along_the_corridor_between_the_points_too(
    scene: PlanningProblem, direction: Array, family: str, points: int
) -> None:
    plain = replace(scene, parametrisation=Parametrisation(family), points=points)
    problem = with_approach(plain, direction)
    require_kept(problem, perform(PlanningTask(problem, SETTINGS)))


@pytest.mark.parametrize("scene", [TUMBLING, RESTING], ids=["tumbling", "resting"])
def test_the_second_first_guess_passes_by_the_open_end_of_the_corridor(
    scene: PlanningProblem,
) -> None:
    problem = in_own_frame(with_approach(scene, SIDEWAYS, 0.2))
    for duration in (problem.duration, 0.9 * problem.duration):
        asked = lasting(replace(problem, duration_range=DurationRange(5.0, 20.0)), duration)
        for paths in (end_effector_paths(asked), end_effector_paths(problem).lasting(asked)):
            _, guess, *_ = islice(paths.first_guesses((), 13, 0.005), 3)
            places, _ = paths.polynomial.pose(guess.reshape(6, 3), np.array([0.75]))
            seen = GraspSeen(asked, np.array([0.75 * duration])).sees(places)
            assert seen[0] == pytest.approx(-0.24 * SIDEWAYS, abs=1e-9)


def test_the_corridor_goes_on_with_a_target_that_drifts_and_turns() -> None:
    moving = replace(
        RESTING.target,
        linear_velocity=np.array([0.01, -0.005, 0.0]),
        angular_velocity=np.array([0.02, 0.0, -0.03]),
    )
    table = load_scenario(LEMUR_SCENARIO.with_name("planar_capture.yaml"))
    heading = Rotation.from_quat(table.target.quaternion_xyzw.copy()).inv()
    assert table.target.linear_velocity.any()
    for scene, direction in (
        (replace(RESTING, target=moving), SIDEWAYS),
        (table, heading.apply([-1.0, -1.0, 0.0])),
    ):
        problem = with_approach(scene, direction, 0.1)
        require_kept(problem, perform(PlanningTask(problem, SETTINGS)))


@pytest.mark.parametrize("scene", [TUMBLING, RESTING], ids=["tumbling", "resting"])
def test_a_plan_that_comes_from_the_side_is_refused_with_angle_distance_and_time(
    scene: PlanningProblem,
) -> None:
    plain = perform(PlanningTask(scene, SETTINGS))
    problem = with_approach(scene, SIDEWAYS)
    assert problem.approach is not None
    times, places = seen_from_grasp(problem, plain)
    assert outside(problem.approach, places).any()
    (failure,) = violations(problem, plain, SETTINGS)
    assert failure.status is Status.LIMIT_VIOLATED
    words = failure.finding.replace(":", "").replace(",", "").split()
    when, away = float(words[words.index("t") + 2]), float(words[words.index("m") - 1])
    angle = float(words[words.index("deg") - 1])
    depth = 1e-3 * float(words[words.index("mm") - 1])
    # What is said of the deepest place is true of the dense motion at that time.
    at = int(np.abs(times - when).argmin())
    near = slice(max(at - 8, 0), at + 9)
    assert np.abs(np.linalg.norm(places[near], axis=1) - away).min() < 1e-3
    assert np.abs(degrees_off(problem.approach, places[near]) - angle).min() < 0.5
    assert "a larger approach.half_angle" in failure.advice
    # A corridor that is wider by as much holds it; the least depth is what was said.
    assert depth == pytest.approx(-problem.approach.margins(places).values.min(), abs=6e-4)


def test_a_corridor_that_holds_the_plan_by_less_than_a_millimetre_is_kept_and_less_is_not() -> None:
    """The bound between the points is neither too loose nor too tight."""
    plain = perform(PlanningTask(RESTING, SETTINGS))
    _, places = seen_from_grasp(RESTING, plain)
    away = np.linalg.norm(places, axis=1)
    entry = places[away > 0.15][-1]
    direction = -entry / np.linalg.norm(entry) + 0.4 * SIDEWAYS  # a little aside of how it comes

    def problem(cone: float) -> PlanningProblem:
        return with_approach(RESTING, direction, 0.15, cone)

    def least(cone: float) -> float:
        return float(Approach(direction, 0.15, cone).margins(places).values.min())

    low, high = 0.05, 1.2
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if least(middle) < 0.0 else (low, middle)
    assert 0.1 < low < 1.0
    narrower = next(cone for cone in np.arange(low, 0.0, -1e-4) if least(cone) < -1e-4)
    wider = next(cone for cone in np.arange(high, 1.5, 1e-4) if least(cone) > 6e-4)
    assert violations(problem(narrower), plain, SETTINGS)
    assert not violations(problem(wider), plain, SETTINGS)


@pytest.mark.ci
@pytest.mark.parametrize("scene", [TUMBLING, RESTING], ids=["tumbling", "resting"])
def test_a_free_duration_keeps_the_corridor(scene: PlanningProblem) -> None:
    body = scene.target_body
    problem = replace(
        with_approach(scene, SIDEWAYS),
        duration=14.0,
        duration_range=DurationRange(9.0, 14.0),
        target=scene.target if body is None else body.target(14.0),
        objective=Objective(1.0, 0.0),
    )
    found = perform(PlanningTask(problem, replace(SETTINGS, starts=3)))
    require_kept(problem, found)


def test_the_plan_is_the_same_in_every_inertial_frame() -> None:
    problem = replace(with_approach(RESTING, SIDEWAYS), points=25)
    frame = FRAMES["at 2 m/s"]
    here = perform(PlanningTask(problem, SETTINGS))
    there = perform(PlanningTask(frame.problem(problem), SETTINGS))
    assert there.trajectory.joint_positions == pytest.approx(
        here.trajectory.joint_positions, abs=1e-6
    )


def test_a_scenario_holds_the_approach_and_its_digest_knows_it(tmp_path: Path) -> None:
    task = PlanningTask(with_approach(RESTING, np.array([0.0, 0.3, -0.2]), 0.123, 0.4), SETTINGS)
    path = tmp_path / "scenario.yaml"
    write_scenario(task, path)
    again = load_task(path, Defaults(SETTINGS))
    assert again.digest == task.digest
    assert again.problem.approach is not None
    plain = PlanningTask(RESTING, SETTINGS)
    others = [
        with_approach(RESTING, FORWARD),
        with_approach(RESTING, FORWARD, 0.2),
        with_approach(RESTING, FORWARD, half_angle=0.3),
        with_approach(RESTING, SIDEWAYS),
    ]
    digests = {PlanningTask(one, SETTINGS).digest for one in others}
    assert len(digests | {plain.digest, task.digest}) == 6
    twice = PlanningTask(with_approach(RESTING, 2.0 * FORWARD), SETTINGS)
    assert twice.digest == PlanningTask(others[0], SETTINGS).digest
    found = perform(plain)
    assert "approach" not in plan_dictionary(found, plain, 0.0)
    assert plan_dictionary(found, task, 0.0)["approach"]["distance"] == 0.123
    content = yaml.safe_load(path.read_text("utf-8"))
    del content["approach"]["half_angle"]
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    default = load_scenario(path).approach
    assert default is not None
    assert default.half_angle == pytest.approx(math.radians(15.0))


@pytest.mark.parametrize(
    ("direction", "distance", "half_angle", "field"),
    [
        ([0.0, 0.0, 0.0], 0.1, 0.2, "approach.direction"),
        ([0.0, 1.0], 0.1, 0.2, "approach.direction"),
        ([0.0, math.nan, 1.0], 0.1, 0.2, "approach.direction"),
        ([0.0, 0.0, 1.0], 0.0, 0.2, "approach.distance"),
        ([0.0, 0.0, 1.0], -1.0, 0.2, "approach.distance"),
        ([0.0, 0.0, 1.0], math.inf, 0.2, "approach.distance"),
        ([0.0, 0.0, 1.0], 0.1, 0.0, "approach.half_angle"),
        ([0.0, 0.0, 1.0], 0.1, 1.6, "approach.half_angle"),
    ],
)
def test_an_impossible_approach_is_refused_by_name(
    direction: list[float], distance: float, half_angle: float, field: str
) -> None:
    with pytest.raises(InvalidInput) as refused:
        Approach(np.array(direction), distance, half_angle)
    assert refused.value.field == field


def test_directions_of_any_length_are_one_direction() -> None:
    for length in (1e-5, 0.3, 3.0, 1e99):
        made = Approach(length * np.array([0.0, 0.6, -0.8]), 0.1)
        assert made.direction == pytest.approx([0.0, 0.6, -0.8], abs=1e-15)
        assert Approach(made.direction, 0.1).direction.tobytes() == made.direction.tobytes()


def test_a_direction_that_the_target_leaves_open_is_refused() -> None:
    free = replace(RESTING, target=replace(RESTING.target, orientation=Orientation.FREE))
    about_z = replace(RESTING.target, orientation=Orientation.ABOUT_AXIS, free_axis_in_ee=FORWARD)
    about = replace(RESTING, target=about_z)
    for problem in (free, about):
        with pytest.raises(InvalidInput, match=r"approach\.direction.*orientation"):
            with_approach(problem, SIDEWAYS)
    with_approach(about, -FORWARD)
    table = load_scenario(LEMUR_SCENARIO.with_name("planar_capture.yaml"))
    to_inertial = Rotation.from_quat(table.target.quaternion_xyzw.copy())
    with pytest.raises(InvalidInput, match="plane of the table"):
        with_approach(table, to_inertial.inv().apply([0.0, 1.0, 1.0]))


def test_a_start_beside_the_corridor_is_refused_with_what_may_be_done() -> None:
    for direction in (SIDEWAYS, -SIDEWAYS):
        problem = with_approach(RESTING, direction, 100.0, 0.05)
        with pytest.raises(InvalidInput, match=r"deg off approach\.direction") as refused:
            perform(PlanningTask(problem, SETTINGS))
        assert refused.value.status is Status.START_OUTSIDE_LIMITS
        assert refused.value.field == "approach.distance"


def test_where_no_path_comes_along_the_corridor_the_refusal_says_so() -> None:
    problem = with_approach(RESTING, SIDEWAYS, 0.3, 0.002)
    with pytest.raises(NoPlanFound, match="corridor of the approach") as refused:
        perform(PlanningTask(problem, replace(SETTINGS, starts=1)))
    assert "a larger approach.half_angle" in str(refused.value)


def test_what_is_drawn_is_the_boundary_of_the_corridor(lemur_plan: Plan) -> None:
    approach = Approach(FORWARD - 0.4 * SIDEWAYS, 0.2, 0.3)
    scene = scene_of(replace(RESTING, approach=approach))
    (drawn,) = drawn_constraints(scene, RESTING.robot, lemur_plan.trajectory)
    points = np.column_stack([drawn.x, drawn.y, drawn.z])
    points = points[np.isfinite(points).all(axis=1)]
    attitude = Rotation.from_quat(RESTING.target.quaternion_xyzw.copy())
    places = attitude.inv().apply(points - RESTING.target.position)
    before = -places @ approach.direction
    assert degrees_off(approach, places) == pytest.approx(math.degrees(0.3), abs=1e-6)
    assert before.min() == pytest.approx(0.0, abs=1e-12)
    assert before.max() == pytest.approx(0.2 * math.cos(0.3))
