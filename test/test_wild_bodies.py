"""Arms that nobody here drew, on a chaser with a panel, meshes and all: planned and verified."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import coal
import pytest
from test_wild_robots import ARMS, file_of, on_a_chaser, robots_of_others
from whole_bodies import WholeBodies

from ff_planner_benchmark.bench.experiment import OBJECTIVES
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.bodies import drawn_problem
from ff_planner_ros.problems.drawn import Drawn
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import Robot, load_robot
from ff_planner_ros.simulation.verification import verify

pytestmark = pytest.mark.ci

SETTINGS = load_parameters().planner
# A chaser that the arm stands on, and a panel to its left.
BOX = (
    '<collision><geometry><box size="0.8 0.8 1.0"/></geometry></collision>'
    '<collision><origin xyz="0 1.2 0"/><geometry><box size="0.6 1.4 0.03"/></geometry></collision>'
)
WILD = (
    "ur5",
    *(pytest.param(name, marks=pytest.mark.nightly) for name in ("ur10", "panda", "xarm7")),
)


def urdf_of(name: str, directory: Path) -> Path:
    """Write an arm on its chaser, with the meshes where its package has them."""
    robot = ElementTree.fromstring(on_a_chaser(file_of(ARMS[name].urdf)))
    chaser = robot.find("link[@name='chaser']")
    assert chaser is not None
    chaser.extend(ElementTree.fromstring(f"<some>{BOX}</some>"))
    text = ElementTree.tostring(robot, encoding="unicode")
    written = directory / f"{name}.urdf"
    written.write_text(text.replace("package://example-robot-data", f"file://{robots_of_others()}"))
    return written


@pytest.fixture(scope="module", params=WILD)
def urdf(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return urdf_of(request.param, tmp_path_factory.mktemp("wild"))


@pytest.fixture(scope="module")
def robot(urdf: Path) -> Robot:
    return load_robot(urdf, "chaser", ARMS[urdf.stem].tip_link)


@pytest.fixture(scope="module")
def drawn(urdf: Path, robot: Robot) -> Drawn[Array]:
    return drawn_problem(robot, urdf.stem, 0)


def test_every_mesh_is_a_body(urdf: Path, robot: Robot) -> None:
    meshes = ElementTree.parse(urdf).findall(".//collision/geometry/mesh")
    assert robot.geometry is Geometry.SHAPES
    assert sum(isinstance(body.solid, coal.Convex) for body in robot.bodies) == len(meshes) > 5


@pytest.mark.law("PLAN-07")
@pytest.mark.parametrize(
    "objective", ["min(L)", pytest.param("min(Theta)", marks=pytest.mark.nightly)]
)
def test_a_plan_among_obstacles_comes_true_without_contact(
    objective: str, urdf: Path, robot: Robot, drawn: Drawn[Array]
) -> None:
    """In MuJoCo with contacts, and as Coal sees the meshes themselves, hulls or not."""
    problem = replace(drawn.problem, objective=OBJECTIVES[objective])
    plan = perform(PlanningTask(problem, SETTINGS))
    found = verify(robot, plan.trajectory, Scene(problem.obstacles))
    assert found.passed, (found.deviation, found.contacts)
    assert found.pairs > len(robot.pairs) > 10
    pairs: dict[str, list[str]] = {}
    for first, second in robot.pairs:
        pairs.setdefault(robot.bodies[first].link, []).append(robot.bodies[second].link)
    judge = WholeBodies(urdf, "chaser", pairs, ARMS[urdf.stem].held)
    assert judge.touching(plan.trajectory, problem.obstacles) == {}
