"""The goal stays in the view of a camera: against a drawing of the cone, differences, the truth."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import yaml
from core_rows import sensitivity_of
from dense_motion import truth
from ff_planner_msgs.msg import Camera as CameraMessage
from geometry_msgs.msg import Vector3
from judging import violations
from recorded_requests import only_request
from reference_goal_rows import angle_gradients
from reference_program import rows_of
from test_any_frame import FRAMES
from test_approach import FAMILIES, RESTING, TUMBLING
from test_approach_over_ros import problem_of
from test_tumbling import moved

from ff_planner_ros.analysis.drawing.surroundings import constraint_lines
from ff_planner_ros.analysis.plan_document import plan_document
from ff_planner_ros.analysis.plan_json import plan_dictionary
from ff_planner_ros.cli import main
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.system_frame import in_own_frame
from ff_planner_ros.planning.problem.camera import Camera
from ff_planner_ros.planning.problem.problem import (
    DurationRange,
    Objective,
    Parametrisation,
    PlanningProblem,
    lasting,
)
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.problem.settings import SearchDepth
from ff_planner_ros.planning.requirements.camera_view import CameraView, _goal_seen
from ff_planner_ros.planning.requirements.requirement import Rows
from ff_planner_ros.planning.scenario.scenario import Defaults, load_scenario, load_task
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.ros.messages.to_messages import request_message
from ff_planner_ros.ros.outputs.markers import plan_markers
from ff_planner_ros.runs.offline_bag import record_answer
from ff_planner_ros.runs.replay import Verdict, replay

SETTINGS = load_parameters().planner
PLACE = np.array([0.05, -0.02, 0.03])  # of a camera in its link [m]
PLANAR = load_scenario(Path(__file__).parent.parent / "config/scenarios/planar_capture.yaml")
SCENES = {"resting": RESTING, "tumbling": TUMBLING, "planar": PLANAR}
EXACT = 6e-4  # to which margins are known between the points, and a little more [m]


def seen(problem: PlanningProblem, camera: Camera, times: Array, q: Array) -> Array:
    """Where the goal is in the camera's axes, by Pinocchio and Euler's equations."""
    model, body, target = problem.robot.model, problem.target_body, problem.target
    goals = target.position + np.outer(times - problem.duration, target.linear_velocity)
    if body is not None:
        centers, attitudes, _ = moved(body, times)
        goals = centers + attitudes.apply(body.grasp_position.copy())
    data, places = model.createData(), []
    for at, goal in zip(q, goals, strict=True):
        pin.framesForwardKinematics(model, data, at)
        link = data.oMf[model.getFrameId(camera.link)]
        places.append(link.rotation.T @ (goal - link.translation) - camera.position)
    return np.array(places)


def degrees_off(camera: Camera, places: Array) -> Array:
    cosine = places @ camera.axis / np.linalg.norm(places, axis=1)
    return np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)))


def along_plan(problem: PlanningProblem, plan: Plan) -> tuple[Array, Array]:
    """Times, and where the goal is in the camera's axes, of the motion that comes of a plan."""
    problem = lasting(problem, plan.duration)
    assert problem.camera is not None
    found = truth(problem, plan.trajectory)
    to_goal = found.time <= problem.duration + 1e-9
    times = found.time[to_goal]
    return times, seen(problem, problem.camera, times, found.q[to_goal])


def require_seen(problem: PlanningProblem, plan: Plan) -> None:
    camera = problem.camera
    assert camera is not None
    times, places = along_plan(problem, plan)
    far = np.linalg.norm(places, axis=1) > camera.until + 1e-6
    assert far.any()
    off = degrees_off(camera, places)
    assert off[far].max() <= math.degrees(camera.half_angle) + 1e-3, (times[far], off[far])
    # Where the goal comes near, the angle changes fast: the truth looks less often than the metric.
    told, true = plan.metrics.max_view_angle, np.deg2rad(off[far].max())
    assert true - 2e-3 <= told <= camera.half_angle + 1e-5
    assert told == pytest.approx(true, abs=0.02)


def looking(
    problem: PlanningProblem, link: str, half_angle: float, until: float = 0.0, aside: float = 0.03
) -> PlanningProblem:
    """A camera on a link that looks at the goal at the start, a little aside."""
    q, _ = configuration(problem.robot, problem.start)
    blind = Camera(link, PLACE, np.array([0.0, 0.0, 1.0]), 1.0)
    place, _ = seen(problem, blind, np.arange(2.0), np.array([q, q]))
    axis = place / np.linalg.norm(place) + aside * np.array([0.6, -0.7, 0.4])
    return replace(problem, camera=Camera(link, PLACE, axis, half_angle, until))


def test_the_view_is_a_cone_that_ends_near_the_goal() -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        until = float(rng.uniform(0.0, 0.5))
        camera = Camera("hand", PLACE, rng.normal(size=3), float(rng.uniform(0.02, 1.5)), until)
        places = rng.normal(scale=0.6, size=(200, 3))
        off = degrees_off(camera, places)
        assert np.rad2deg(camera.angles(places)) == pytest.approx(off, abs=1e-5)
        inside = (off < math.degrees(camera.half_angle)) | (np.linalg.norm(places, axis=1) < until)
        margins = camera.margins(places)
        assert ((margins > 0.0) == inside).all()
        others = places + rng.normal(scale=0.1, size=places.shape)
        change = np.abs(camera.margins(others) - margins)
        assert (change <= np.linalg.norm(others - places, axis=1) + 1e-12).all()
        way, step = rng.normal(size=3), 1e-6
        slope = (camera.angles(places + step * way) - camera.angles(places - step * way)) / 2e-6
        told = angle_gradients(camera, places) @ way
        assert told == pytest.approx(slope, rel=1e-4, abs=1e-5)
        on_axis = angle_gradients(camera, 0.3 * camera.axis[None])
        assert np.linalg.norm(on_axis) <= 1.0 / 0.3 + 1e-9


@pytest.mark.parametrize("name", list(FAMILIES))
@pytest.mark.parametrize("scene", [TUMBLING, RESTING], ids=["tumbling", "resting"])
@pytest.mark.parametrize("link", ["chaser", "link_4", "end_effector"])
def test_derivatives_of_the_rows_agree_with_differences(
    name: str, scene: PlanningProblem, link: str
) -> None:
    """By the angle and by the distance, with a goal that moves in the frame of the plan."""
    problem = in_own_frame(looking(scene, link, 0.3, 0.4))
    family, required = FAMILIES[name](problem), CameraView()
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
    assert len(set(names)) == len(names) > 5
    if link == "end_effector":  # the distance counts for some, else the cone
        assert {name % 2 for name in names} == {0, 1}
    for _ in range(5):
        way = rng.normal(size=family.variables)
        step = 1e-6 / np.linalg.norm(way)
        before, after = values(x - step * way), values(x + step * way)
        known = [k for k, name in enumerate(names) if name in before and name in after]
        assert len(known) > 0.9 * len(names)
        slope = np.array([after[names[k]] - before[names[k]] for k in known]) / (2 * step)
        told = (here.jacobian @ way)[known]
        assert told == pytest.approx(slope, abs=5e-6 * np.abs(slope).max())


@pytest.mark.parametrize("link", ["chaser", "link_4", "end_effector"])
def test_the_camera_sees_the_goal_move_as_its_place_changes(link: str) -> None:
    problem = in_own_frame(looking(TUMBLING, link, 0.5))
    assert problem.camera is not None
    model, rng, step = problem.robot.model, np.random.default_rng(5), 1e-5
    q, _ = configuration(problem.robot, problem.start)
    v, times = 0.3 * rng.normal(size=model.nv), np.array([2.0])

    def places(later: float) -> tuple[Array, Array]:
        at = pin.integrate(model, q, later * v)
        return _goal_seen(problem, problem.camera, times + later, at[None], v[None])

    slope = (places(step)[0] - places(-step)[0]) / (2 * step)
    assert places(0.0)[1] == pytest.approx(slope, abs=1e-8)


@pytest.mark.sampled
@pytest.mark.law("PLAN-13")
@pytest.mark.parametrize("points", [50, pytest.param(13, marks=pytest.mark.ci)])
@pytest.mark.parametrize("family", ["end_effector_polynomial", "joint_spline"])
@pytest.mark.parametrize(
    ("scene", "link", "half_angle", "until"),
    [
        ("resting", "chaser", 0.2, 0.1),
        ("resting", "end_effector", 0.12, 0.15),
        ("resting", "link_5", 0.2, 0.1),
        ("tumbling", "end_effector", 0.3, 0.2),
        ("planar", "end_effector", 0.3, 0.2),
    ],
)
def test_the_goal_stays_in_view_between_the_points_too(
    scene: str, link: str, half_angle: float, until: float, family: str, points: int
) -> None:
    plain = replace(SCENES[scene], points=points)
    if scene != "planar":
        plain = replace(plain, parametrisation=Parametrisation(family))
    link = plain.robot.tip_link if link == "end_effector" else link
    problem = looking(plain, link, half_angle, until)
    plan = perform(PlanningTask(problem, SETTINGS))
    require_seen(problem, plan)


@pytest.mark.ci
def test_least_attitude_and_a_free_duration_keep_the_view() -> None:
    least = replace(looking(RESTING, "end_effector", 0.2, 0.1), objective=Objective(0.0, 1.0))
    require_seen(least, perform(PlanningTask(least, replace(SETTINGS, search=SearchDepth.QUICK))))
    free = looking(TUMBLING, "end_effector", 0.3, 0.2)
    assert free.target_body is not None
    free = replace(
        free,
        duration=14.0,
        duration_range=DurationRange(9.0, 14.0),
        target=free.target_body.target(14.0),
        objective=Objective(1.0, 0.0),
    )
    require_seen(free, perform(PlanningTask(free, replace(SETTINGS, starts=3))))


@pytest.mark.ci
def test_the_plan_is_the_same_in_every_inertial_frame() -> None:
    problem = looking(replace(RESTING, points=25), "end_effector", 0.1, 0.15)
    here = perform(PlanningTask(problem, SETTINGS))
    for name in ("at 2 m/s", "in orbit"):
        there = perform(PlanningTask(FRAMES[name].problem(problem), SETTINGS))
        assert there.trajectory.joint_positions == pytest.approx(
            here.trajectory.joint_positions, abs=1e-6
        ), name
        assert there.metrics.max_view_angle == pytest.approx(here.metrics.max_view_angle, abs=1e-6)


@cache
def without_camera(scene: str) -> Plan:
    return perform(PlanningTask(SCENES[scene], SETTINGS))


@pytest.mark.law("PLAN-13")
@pytest.mark.parametrize("scene", ["resting", "tumbling"])
def test_a_plan_that_loses_the_goal_is_refused_with_link_angle_and_time(scene: str) -> None:
    problem = looking(SCENES[scene], "end_effector", 0.1, 0.1)
    camera, plan = problem.camera, without_camera(scene)
    assert camera is not None
    times, places = along_plan(problem, plan)
    (failure,) = violations(problem, plan, SETTINGS)
    assert failure.status is Status.LIMIT_VIOLATED
    assert "the camera on end_effector sees the goal" in failure.finding
    words = failure.finding.replace(":", "").replace(",", "").split()
    when, angle = float(words[words.index("t") + 2]), float(words[words.index("deg") - 1])
    away = float(words[words.index("away") - 2])
    at = int(camera.margins(places).argmin())
    assert when == pytest.approx(times[at], abs=0.1)
    near = slice(max(at - 8, 0), at + 9)
    assert np.abs(degrees_off(camera, places[near]) - angle).min() < 0.5
    assert np.abs(np.linalg.norm(places[near], axis=1) - away).min() < 1e-3
    assert "a larger camera.half_angle" in failure.advice


def test_a_view_that_holds_the_plan_by_less_than_a_millimetre_is_kept_and_less_is_not() -> None:
    """The bound between the points is neither too loose nor too tight."""
    plan = without_camera("resting")

    def problem(half_angle: float) -> PlanningProblem:
        return looking(RESTING, "end_effector", half_angle, 0.2)

    _, places = along_plan(problem(1.0), plan)

    def least(half_angle: float) -> float:
        camera = problem(half_angle).camera
        assert camera is not None
        return float(camera.margins(places).min())

    low, high = 0.01, 1.5
    assert least(low) < 0.0 < least(high)
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if least(middle) < 0.0 else (low, middle)
    narrower = next(angle for angle in np.arange(low, 0.0, -1e-4) if least(angle) < -1e-4)
    wider = next(angle for angle in np.arange(high, 1.5, 1e-4) if least(angle) > EXACT)
    assert violations(problem(narrower), plan, SETTINGS)
    assert not violations(problem(wider), plan, SETTINGS)


def test_once_near_the_goal_may_leave_the_view_and_a_view_that_is_too_narrow_is_said() -> None:
    plan = without_camera("resting")
    problem = looking(RESTING, "end_effector", 0.1, 100.0)
    assert not violations(problem, plan, SETTINGS)
    narrow = looking(RESTING, "end_effector", 0.02, aside=0.01)
    with pytest.raises(NoPlanFound, match="camera on end_effector") as refused:
        perform(PlanningTask(narrow, replace(SETTINGS, starts=1)))
    assert "a larger camera.until" in str(refused.value)


def test_a_start_that_does_not_see_the_goal_is_refused() -> None:
    problem = looking(RESTING, "link_5", 0.2)
    assert problem.camera is not None
    away = replace(problem.camera, axis=-problem.camera.axis)
    with pytest.raises(InvalidInput, match="camera on link_5 sees the goal 17") as refused:
        perform(PlanningTask(replace(problem, camera=away), SETTINGS))
    assert refused.value.status is Status.START_OUTSIDE_LIMITS
    assert refused.value.field == "camera.half_angle"


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("axis", [0.0, 0.0, 0.0]),
        ("axis", [0.0, math.nan, 1.0]),
        ("axis", [1.0, 0.0]),
        ("position", [0.0, math.inf, 1.0]),
        ("half_angle", 0.0),
        ("half_angle", -0.1),
        ("half_angle", 1.6),
        ("half_angle", math.nan),
        ("until", -0.1),
        ("until", math.inf),
    ],
)
def test_an_impossible_camera_is_refused_by_name(field: str, value: Any) -> None:
    good = {"link": "link_5", "position": [0, 0, 0], "axis": [0, 0, 1], "half_angle": 0.3}
    with pytest.raises(InvalidInput) as refused:
        Camera(**good | {field: value})
    assert refused.value.field == f"camera.{field}"


def test_a_camera_on_a_link_that_there_is_not_is_refused() -> None:
    camera = Camera("mast", PLACE, np.array([0.0, 0.0, 1.0]), 0.3)
    with pytest.raises(InvalidInput, match=r"camera\.link is 'mast'.*link_5") as refused:
        replace(RESTING, camera=camera)
    assert refused.value.status is Status.OUT_OF_RANGE


def test_a_scenario_holds_the_camera_and_its_digest_knows_it(tmp_path: Path) -> None:
    problem, path = looking(RESTING, "link_5", 0.3, 0.1), tmp_path / "scenario.yaml"
    task = PlanningTask(problem, SETTINGS)
    write_scenario(task, path)
    assert load_task(path, Defaults(SETTINGS)).digest == task.digest
    assert problem.camera is not None
    others = [
        replace(problem, camera=None),
        looking(RESTING, "link_6", 0.3, 0.1),
        looking(RESTING, "link_5", 0.31, 0.1),
        looking(RESTING, "link_5", 0.3, 0.2),
        looking(RESTING, "link_5", 0.3, 0.1, aside=0.1),
        replace(problem, camera=replace(problem.camera, position=np.zeros(3))),
    ]
    digests = {PlanningTask(one, SETTINGS).digest for one in (problem, *others)}
    assert len(digests) == 7
    content = yaml.safe_load(path.read_text("utf-8"))
    del content["camera"]["until"]
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    camera = load_scenario(path).camera
    assert camera is not None
    assert camera.until == 0.0


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"link": "mast"}, "link"),
        ({"link": ""}, "link"),
        ({"axis": Vector3()}, "axis"),
        ({"axis": Vector3(x=float("nan"))}, "axis"),
        ({"half_angle": 0.0}, "half_angle"),
        ({"half_angle": 1.6}, "half_angle"),
        ({"until": -1.0}, "until"),
    ],
)
def test_a_request_with_an_impossible_camera_is_refused_by_its_field(
    changes: dict[str, Any], field: str
) -> None:
    request = request_message(looking(RESTING, "link_5", 0.3), "inertial")
    for name, value in changes.items():
        setattr(request.camera[0], name, value)
    with pytest.raises(InvalidInput) as refused:
        problem_of(request)
    assert refused.value.field == f"camera.{field}"


def test_request_json_bag_replay_report_and_markers_have_the_camera(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    problem = looking(RESTING, "end_effector", 0.2, 0.1)
    task = PlanningTask(problem, SETTINGS)
    plan, camera = perform(task), problem.camera
    assert camera is not None
    request = request_message(problem, "inertial")
    assert isinstance(request.camera[0], CameraMessage)
    back = problem_of(request).camera
    assert back is not None
    assert back.axis.tolist() == camera.axis.tolist()
    assert (back.link, back.half_angle, back.until) == ("end_effector", 0.2, 0.1)
    assert problem_of(request_message(RESTING, "inertial")).camera is None

    answer, bag, page = tmp_path / "answer.json", tmp_path / "bag", tmp_path / "page.html"
    answer.write_text(json.dumps(plan_dictionary(plan, task, 0.5)))
    document = plan_document(json.loads(answer.read_text()))
    assert document.scene.camera is not None
    assert document.plan.metrics.max_view_angle == plan.metrics.max_view_angle
    record_answer(bag, task, plan, 0.5)
    recorded = only_request(bag)
    assert recorded.planned_task().digest == task.digest
    assert replay(recorded).verdict is Verdict.IDENTICAL
    for source in (answer, bag):
        assert main(["report", str(source), "--output", str(page)]) == 0
        text = page.read_text()
        assert "on end_effector, sees 11.46 deg to each side" in text
        assert "the goal stays in view until it is 0.1 m from the goal" in text
        assert '"name":"camera"' in text
    capsys.readouterr()
    assert main(["replay", str(bag), "--set", "camera.half_angle=0.25"]) == 0
    assert "SOLVED" in capsys.readouterr().out
    assert main(["replay", str(bag), "--set", "camera.half_angle=-1"]) == 2
    assert "camera.half_angle is -1.0" in capsys.readouterr().err

    markers = plan_markers(problem.robot, plan, scene_of(problem), "inertial").markers
    (drawn,) = (marker for marker in markers if marker.ns == "camera")
    lines = constraint_lines(scene_of(problem), problem.robot, plan.trajectory)["camera"]
    assert len(drawn.points) == 2 * len(lines) > 0
    # The first lines go from the camera at the start to the edge of its view.
    q, _ = configuration(problem.robot, problem.start)
    place, _ = seen(problem, camera, np.arange(2.0), np.array([q, q]))
    rays = lines[:12, 1] - lines[:12, 0]
    goal = problem.target.position - lines[0, 0]
    assert np.linalg.norm(goal) == pytest.approx(np.linalg.norm(place))
    mean = rays.mean(axis=0) / np.linalg.norm(rays.mean(axis=0))
    cosine = rays @ mean / np.linalg.norm(rays, axis=1)
    assert np.arccos(cosine) == pytest.approx(np.full(12, 0.2), abs=1e-6)
    assert mean @ goal / np.linalg.norm(goal) == pytest.approx(
        math.cos(math.radians(degrees_off(camera, place[None])[0])), abs=1e-6
    )
