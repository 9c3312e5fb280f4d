"""A robot with meshes and an SRDF is written down whole: no other file is needed to plan again."""

from __future__ import annotations

import shutil
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from test_meshes import BOX, stl, urdf_with
from test_pairs import disabling

from ff_planner_ros.analysis.plan_document import planned_motion
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.parameters.robot import RobotParameters, WheelParameters
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.problem import Objective, Orientation, PlanningProblem, Target
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState

SETTINGS = load_parameters().planner


def parameters(directory: Path, geometry: str = "auto") -> RobotParameters:
    urdf, srdf = directory / "arm.urdf", directory / "arm.srdf"
    return RobotParameters(
        WheelParameters(),
        str(urdf),
        "bus",
        "tool",
        "free_flyer",
        "joint_1: 0.3",
        geometry,
        str(srdf),
        1.0,
    )


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    """Of a URDF with a mesh, an SRDF, and nothing else; the test may take it away."""
    place = tmp_path / "arm"
    place.mkdir()
    (place / "box.stl").write_bytes(stl(BOX))
    text = urdf_with('<mesh filename="box.stl" scale="0.3 1.1 0.7"/>')
    solid = '<collision><geometry><sphere radius="0.05"/></geometry></collision>'
    (place / "arm.urdf").write_text(
        text.replace('<link name="link_4">', f'<link name="link_4">{solid}')
    )
    (place / "arm.srdf").write_text(disabling(("link_1", "link_4")))
    return place


def loaded(directory: Path) -> Robot:
    return parameters(directory).load((directory / "arm.urdf").read_text(), directory)


def task_of(robot: Robot) -> PlanningTask:
    still = np.zeros(3)
    joints = np.zeros(robot.joints)
    start = SystemState(still, np.array([0, 0, 0, 1.0]), still, still, joints, joints)
    target = Target(still, start.quaternion_chaser_to_inertial_xyzw, orientation=Orientation.FREE)
    problem = PlanningProblem(robot, start, target, 5.0, 20, (), Objective(1.0, 0.0))
    return PlanningTask(problem, SETTINGS)


def require_same(ours: Robot, theirs: Robot) -> None:
    assert task_of(ours).digest == task_of(theirs).digest
    assert (ours.geometry, ours.pairs, ours.may_touch) == (
        *(theirs.geometry, theirs.pairs),
        theirs.may_touch,
    )
    for one, other in zip(ours.bodies, theirs.bodies, strict=True):
        assert one.solid == other.solid
        assert one.placement_in_joint == other.placement_in_joint


@pytest.mark.parametrize("geometry", ["auto", "lines"])
def test_a_node_s_bag_holds_the_whole_robot(directory: Path, geometry: str) -> None:
    from ff_planner_ros.ros.recorder.recording import attached_parameters

    told = parameters(directory, geometry)
    robot = told.load((directory / "arm.urdf").read_text(), directory)
    written = attached_parameters(replace(load_parameters(), robot=told), robot).robot
    shutil.rmtree(directory)
    require_same(written.load(robot.drawn_urdf, None), robot)


def test_an_answer_without_a_geometry_means_what_its_urdf_has(directory: Path) -> None:
    robot = loaded(directory)
    links = {"base_link": "bus", "tip_link": "tool"}
    samples = {item.name: list[float]() for item in fields(Trajectory)}
    answer = {"status": "solved", "joint_names": list(robot.joint_names), **samples}
    answer["robot"] = {"urdf": robot.urdf} | links
    assert planned_motion(answer)[0].geometry is Geometry.LINES
    answer["robot"] = {"urdf": robot.drawn_urdf} | links
    assert planned_motion(answer)[0].geometry is Geometry.SHAPES
    assert planned_motion(answer | {"geometry": "lines"})[0].geometry is Geometry.LINES
    with pytest.raises(InvalidInput, match="geometry is 'skin': it must be shapes or lines"):
        planned_motion(answer | {"geometry": "skin"})


def test_a_scenario_holds_the_whole_robot(directory: Path, tmp_path: Path) -> None:
    task = task_of(loaded(directory))
    shutil.rmtree(directory)
    write_scenario(task, tmp_path / "capture.yaml")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["capture.urdf", "capture.yaml"]
    again = load_task(tmp_path / "capture.yaml", Defaults(SETTINGS))
    require_same(again.problem.robot, task.problem.robot)


def test_the_digest_knows_bodies_and_pairs_and_with_lines_neither(directory: Path) -> None:
    robot = loaded(directory)
    text = (directory / "arm.urdf").read_text()
    others = [replace(robot, pairs=((0, 2),)), replace(robot, bodies=robot.bodies[1:])]
    for old, new in (('radius="0.05"', 'radius="0.06"'), ('scale="0.3', 'scale="0.31')):
        assert old in text
        others.append(parameters(directory).load(text.replace(old, new), directory))
    lines = parameters(directory, "lines").load(text, directory)
    digests = {task_of(one).digest for one in (robot, lines, *others)}
    assert len(digests) == 2 + len(others)
    bare = text.partition("<robot")[1] + text.partition("<robot")[2]
    thicker = parameters(directory, "lines").load(bare.replace('"0.05"', '"0.5"'), directory)
    assert task_of(thicker).digest == task_of(lines).digest


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"geometry": "skin"}, "robot.geometry is 'skin': it must be shapes or lines"),
        ({"geometry": 7}, "robot.geometry is 7"),
        ({"srdf": "gone.srdf"}, "robot.srdf is gone.srdf: there is no file"),
        ({"srdf": 7}, "robot.srdf is 7: it must be text"),
        ({"srdf": "package://gone/a.srdf"}, "robot.srdf is package://gone/a.srdf: there is no"),
    ],
)
def test_a_scenario_names_geometry_and_srdf_or_is_refused(
    entry: dict[str, object], words: str, directory: Path
) -> None:
    path = directory / "capture.yaml"
    write_scenario(task_of(loaded(directory)), path)
    scenario = yaml.safe_load(path.read_text())
    scenario["robot"] |= {"urdf": "arm.urdf", "locked_joints": {"joint_1": 0.3}} | entry
    path.write_text(yaml.safe_dump(scenario))
    with pytest.raises(InvalidInput) as refusal:
        load_task(path, Defaults(SETTINGS))
    assert words in str(refusal.value)
    scenario["robot"] |= {"geometry": "shapes", "srdf": "arm.srdf"}
    path.write_text(yaml.safe_dump(scenario))
    require_same(load_task(path, Defaults(SETTINGS)).problem.robot, loaded(directory))
