"""The scene for the browser: everything is where it belongs, nothing comes from elsewhere."""

from __future__ import annotations

import json
from collections.abc import Collection
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pinocchio as pin
import plotly.graph_objects as go
import pytest
from drawn_plans import DURATION, POINTS, drawn_plan, paper_terms_at
from scipy.spatial.transform import Rotation

from ff_planner_ros.analysis.drawing.scene import save_scene, scene_figure
from ff_planner_ros.analysis.drawing.surroundings import near_arm
from ff_planner_ros.analysis.methods import PAPERS_METHODS, SHORTEST, STEADIEST, Method
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import Obstacle, Orientation, PlanningProblem
from ff_planner_ros.robot.model import Robot


@pytest.fixture(scope="module")
def plans(lemur: Robot) -> dict[Method, Plan]:
    return {method: drawn_plan(lemur, seed) for seed, method in enumerate(PAPERS_METHODS)}


@pytest.fixture(scope="module")
def figure(lemur_capture: PlanningProblem, plans: dict[Method, Plan]) -> go.Figure:
    return scene(lemur_capture, plans, {SHORTEST})


def scene(
    problem: PlanningProblem, plans: dict[Method, Plan], shown: Collection[Method]
) -> go.Figure:
    motions = {method: plan.trajectory for method, plan in plans.items()}
    return scene_figure(problem.robot, problem.obstacles, problem.target, motions, shown)


def coordinates(trace: go.Scatter3d | go.Mesh3d) -> Array:
    return np.stack([np.asarray(trace[axis], float) for axis in "xyz"], axis=1)


def lines(trace: go.Scatter3d) -> list[Array]:
    """The lines of a trace, which gaps part."""
    points = coordinates(trace)
    gaps = np.flatnonzero(np.isnan(points[:, 0]))
    return [part[~np.isnan(part[:, 0])] for part in np.split(points, gaps) if len(part) > 1]


def drawn(figure: go.Figure, method: Method, what: str, point: int = 0) -> go.Scatter3d:
    """A trace of a method as the browser shows it once the slider is moved to a frame."""
    (index,) = (
        k
        for k, trace in enumerate(figure.data)
        if trace.legendgroup == method.name and f", {what}<br>" in trace.hovertemplate
    )
    frame = figure.frames[point]
    if index in frame.traces:
        return frame.data[frame.traces.index(index)]
    return figure.data[index]


def test_every_obstacle_is_a_closed_sphere_of_its_size_in_its_place(
    figure: go.Figure, lemur_capture: PlanningProblem
) -> None:
    meshes = [trace for trace in figure.data if trace.name == "obstacles"]
    for mesh, sphere in zip(meshes, lemur_capture.obstacles, strict=True):
        assert mesh.hovertemplate.startswith(f"{sphere.id}, ")
        corners = coordinates(mesh) - sphere.center
        np.testing.assert_allclose(np.linalg.norm(corners, axis=1), sphere.radius)
        a, b, c = (corners[np.asarray(mesh[key])] for key in "ijk")
        volume = np.sum(a * np.cross(b, c)) / 6
        assert volume == pytest.approx(4 / 3 * np.pi * sphere.radius**3, rel=0.05)
    assert [mesh.showlegend for mesh in meshes] == [True, False, False]


def test_the_slider_moves_a_moving_obstacle(
    lemur_capture: PlanningProblem, plans: dict[Method, Plan]
) -> None:
    velocity = np.array([0.1, -0.2, 0.05])
    first, *others = lemur_capture.obstacles
    problem = replace(lemur_capture, obstacles=(*others, first.with_motion(velocity=velocity)))
    figure = scene(problem, plans, set(plans))
    index = len(others)
    for point in (0, 13, POINTS - 1):
        frame = figure.frames[point]
        mesh = frame.data[frame.traces.index(index)]
        center = first.center + point * DURATION / (POINTS - 1) * velocity
        away = np.linalg.norm(coordinates(mesh) - center, axis=1)
        np.testing.assert_allclose(away, first.radius)
        (arm,) = lines(frame.data[frame.traces.index(len(problem.obstacles) + 3)])
        (expected,) = lines(drawn(figure, next(iter(plans)), "arm", point))
        np.testing.assert_array_equal(arm, expected)


def test_paths_are_those_of_end_effector_and_chaser(
    figure: go.Figure, plans: dict[Method, Plan]
) -> None:
    for method, plan in plans.items():
        ends = [paper_terms_at(plan, point).r_ee for point in range(POINTS)]
        (path,) = lines(drawn(figure, method, "end effector"))
        np.testing.assert_allclose(path, ends, atol=1e-9)
        (path,) = lines(drawn(figure, method, "chaser's way"))
        np.testing.assert_allclose(path, plan.trajectory.chaser_positions)


def test_the_slider_moves_every_methods_arm_to_where_it_is_at_that_time(
    figure: go.Figure, plans: dict[Method, Plan]
) -> None:
    assert len(figure.frames) == POINTS
    for step, frame in zip(figure.layout.sliders[0].steps, figure.frames, strict=True):
        assert list(step.args[0]) == [frame.name]
    for point in (0, 13, POINTS - 1):
        assert float(figure.frames[point].name) == pytest.approx(
            point * DURATION / (POINTS - 1), abs=0.005
        )
        for method, plan in plans.items():
            terms = paper_terms_at(plan, point)
            (arm,) = lines(drawn(figure, method, "arm", point))
            np.testing.assert_allclose(arm, np.vstack([terms.r_joint, terms.r_ee]), atol=1e-9)
            *_, mount = lines(drawn(figure, method, "chaser", point))
            chaser = plan.trajectory.chaser_positions[point]
            np.testing.assert_allclose(mount, [chaser, terms.r_joint[0]], atol=1e-9)


def test_the_arm_is_seen_at_start_and_end_and_on_its_way(
    figure: go.Figure, plans: dict[Method, Plan]
) -> None:
    arms = lines(drawn(figure, STEADIEST, "arm on its way"))
    assert len(arms) == 5
    for arm, point in ((arms[0], 0), (arms[-1], POINTS - 1)):
        end = paper_terms_at(plans[STEADIEST], point).r_ee
        np.testing.assert_allclose(arm[-1], end, atol=1e-9)


def test_the_chasers_box_has_the_chasers_inertia(
    robot: Robot, lemur_capture: PlanningProblem
) -> None:
    """A uniform box has the second moments m a^2 / 3 about its centre, a its half edges."""
    plan = drawn_plan(robot, seed=5)
    figure = scene(replace_robot(lemur_capture, robot), {SHORTEST: plan}, {SHORTEST})
    q, _ = from_trajectory(robot, plan.trajectory)
    data = robot.model.createData()
    for point in (0, POINTS - 1):
        pin.forwardKinematics(robot.model, data, q[point])
        chaser = data.oMi[1].act(robot.model.inertias[1])
        *edges, _ = lines(drawn(figure, SHORTEST, "chaser", point))
        assert len(edges) == 12
        ends = np.concatenate(edges) - chaser.lever  # every corner three times
        second = chaser.mass / 3 * ends.T @ ends / len(ends)
        inertia = np.trace(second) * np.eye(3) - second
        np.testing.assert_allclose(inertia, chaser.inertia, rtol=1e-9, atol=1e-9 * inertia.max())
        directions = np.array([(b - a) / np.linalg.norm(b - a) for a, b in edges])
        aligned = np.abs(directions @ directions.T)
        np.testing.assert_allclose(np.minimum(aligned, np.abs(aligned - 1.0)), 0.0, atol=1e-9)


def replace_robot(problem: PlanningProblem, robot: Robot) -> PlanningProblem:
    """The same scene for another robot; its start does not matter here."""
    zeros = np.zeros(robot.joints)
    start = replace(problem.start, joint_positions=zeros, joint_velocities=zeros)
    return replace(problem, robot=robot, start=start)


def test_each_method_has_one_entry_in_the_legend_and_hides_as_a_whole(
    figure: go.Figure, plans: dict[Method, Plan]
) -> None:
    for method in plans:
        traces = [trace for trace in figure.data if trace.legendgroup == method.name]
        assert sum(trace.showlegend for trace in traces) == 1
        assert len(traces) == 7
        assert {trace.name for trace in traces} == {method.label}
        lines_of = [t for t in traces if t.type == "scatter3d" and "axes" not in t.hovertemplate]
        assert {trace.line.color for trace in lines_of} == {method.colour}
        # A click in the legend shows its paths; buttons show one robot at a time.
        visible = True if method is SHORTEST else "legendonly"
        assert {trace.visible for trace in traces[4:]} == {visible}
        assert {trace.visible for trace in traces[:4]} == {method is SHORTEST}
    (menu,) = (one for one in figure.layout.updatemenus if one.buttons[0].method == "restyle")
    assert [one.label for one in menu.buttons] == [method.label for method in plans]
    for method, button in zip(plans, menu.buttons, strict=True):
        told, traces = button.args
        shown = {
            figure.data[k].name for k, seen in zip(traces, told["visible"], strict=True) if seen
        }
        assert shown == {method.label}


def test_robots_and_obstacles_are_opaque_and_lit(figure: go.Figure) -> None:
    surfaces = [trace for trace in figure.data if trace.type == "mesh3d"]
    assert surfaces
    assert {trace.opacity for trace in surfaces} == {None}
    assert all(trace.lighting.diffuse > 0.5 for trace in surfaces)


def test_the_goal_is_marked(figure: go.Figure, lemur_capture: PlanningProblem) -> None:
    goal, axes = (trace for trace in figure.data if trace.name == "goal")
    target = lemur_capture.target
    np.testing.assert_array_equal(coordinates(goal), [target.position])
    ends = np.array([line[1] for line in lines(axes)]) - target.position
    turn = Rotation.from_quat(target.quaternion_xyzw).as_matrix()
    np.testing.assert_allclose(ends / np.linalg.norm(ends[0]), turn.T, atol=1e-12)
    red, green, blue = "#e41a1c", "#4daf4a", "#377eb8"
    assert list(axes.line.color) == [*[red] * 3, *[green] * 3, *[blue] * 3]


def test_a_goal_of_any_orientation_has_no_axes(
    lemur_capture: PlanningProblem, plans: dict[Method, Plan]
) -> None:
    free = replace(lemur_capture.target, orientation=Orientation.FREE)
    figure = scene(replace(lemur_capture, target=free), plans, plans)
    assert len([trace for trace in figure.data if trace.name == "goal"]) == 1


def test_the_end_effector_s_axes_move_with_it(figure: go.Figure, plans: dict[Method, Plan]) -> None:
    """They are lines from the end effector on, of one length, in the order x, y, z."""
    for method, plan in plans.items():
        for point in (0, 17, POINTS - 1):
            axes = lines(drawn(figure, method, "end effector's axes", point))
            (arm,) = lines(drawn(figure, method, "arm", point))
            turn = Rotation.from_quat(plan.trajectory.ee_quaternions_xyzw[point]).as_matrix()
            lengths = [np.linalg.norm(end - origin) for origin, end in axes]
            np.testing.assert_allclose(lengths, lengths[0])
            for (origin, end), wanted, length in zip(axes, turn.T, lengths, strict=True):
                np.testing.assert_array_equal(origin, arm[-1])
                np.testing.assert_allclose(end - origin, length * wanted, atol=1e-12)


def test_obstacles_far_from_the_arm_and_more_than_a_browser_bears_are_left_out() -> None:
    arm = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]])
    times = np.zeros(1)
    spheres = [Obstacle.sphere(f"s{k}", [-0.01 * k, 0.0, 1.0], 0.1) for k in range(150)]
    assert near_arm(spheres[:100], times, arm) == spheres[:100]
    assert near_arm(spheres, times, arm) == spheres[:100]
    far = Obstacle.sphere("far", [9.0, 0.0, 0.0], 0.1)
    assert near_arm([far, spheres[0]], times, arm) == [spheres[0]]
    coming = Obstacle.sphere("coming", [9.0, 0.0, 0.0], 0.1, velocity=[-1.0, 0.0, 0.0])
    both = np.array([0.0, 8.0]), np.concatenate([arm, arm])
    assert near_arm([coming, far], *both) == [coming]
    assert near_arm([], times, arm) == []


def test_axes_have_one_scale_and_hold_everything_at_all_times(figure: go.Figure) -> None:
    axes = figure.layout.scene
    ranges = np.array([axes[f"{axis}axis"].range for axis in "xyz"])
    ratio = np.array([axes.aspectratio[axis] for axis in "xyz"])
    scale = ratio / (ranges[:, 1] - ranges[:, 0])
    np.testing.assert_allclose(scale, scale[0])
    traces = [*figure.data, *(trace for frame in figure.frames for trace in frame.data)]
    for trace in traces:
        points = coordinates(trace)
        assert np.all(np.nanmin(points, axis=0) > ranges[:, 0])
        assert np.all(np.nanmax(points, axis=0) < ranges[:, 1])


def test_a_long_plan_has_as_many_frames_as_the_eye_needs_from_start_to_end(
    lemur_capture: PlanningProblem, plans: dict[Method, Plan]
) -> None:
    trajectory = plans[SHORTEST].trajectory
    repeated = {
        name: np.repeat(getattr(trajectory, name), 5, axis=0)
        for name in trajectory.__dataclass_fields__
    }
    repeated["time"] = np.linspace(0.0, DURATION, 5 * POINTS)
    long = replace(plans[SHORTEST], trajectory=replace(trajectory, **repeated))
    names = [frame.name for frame in scene(lemur_capture, {SHORTEST: long}, {SHORTEST}).frames]
    assert len(names) == 50
    assert (names[0], names[-1]) == ("0.00", "10.00")


def test_without_obstacles_there_is_a_scene(
    lemur_capture: PlanningProblem, plans: dict[Method, Plan]
) -> None:
    figure = scene(replace(lemur_capture, obstacles=()), plans, plans)
    assert not [trace for trace in figure.data if trace.name == "obstacles"]


class Page(HTMLParser):
    """What a page loads, and the text of its scripts."""

    def __init__(self) -> None:
        super().__init__()
        self.loaded: list[tuple[str, str | None]] = []
        self.scripts: list[str] = []
        self._in_script = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._in_script = tag == "script"
        self.loaded += [(tag, value) for name, value in attrs if name in ("src", "href", "data")]

    def handle_endtag(self, tag: str) -> None:
        self._in_script = self._in_script and tag != "script"

    def handle_data(self, data: str) -> None:
        if self._in_script:
            self.scripts.append(data)


@pytest.fixture(scope="module")
def page(
    lemur_capture: PlanningProblem,
    plans: dict[Method, Plan],
    tmp_path_factory: pytest.TempPathFactory,
) -> str:
    path = tmp_path_factory.mktemp("scene") / "scene.html"
    motions = {method: plan.trajectory for method, plan in plans.items()}
    save_scene(lemur_capture, motions, {SHORTEST}, path)
    return path.read_text(encoding="utf-8")


def test_the_page_loads_nothing_and_holds_the_library_and_every_trace(
    page: str, figure: go.Figure, lemur_capture: PlanningProblem
) -> None:
    parsed = Page()
    parsed.feed(page)
    assert parsed.loaded == []
    call = parsed.scripts[-1]
    assert any("plotly.js v" in script[:200] for script in parsed.scripts)
    assert "://" not in call
    traces, _ = json.JSONDecoder().raw_decode(call, call.index("[", call.index("Plotly.newPlot")))
    assert [trace["hovertemplate"] for trace in traces] == [
        trace.hovertemplate for trace in figure.data
    ]
    obstacles = [trace for trace in traces if trace["name"] == "obstacles"]
    assert len(obstacles) == len(lemur_capture.obstacles)


def test_the_same_plans_give_the_same_page(
    page: str, lemur_capture: PlanningProblem, plans: dict[Method, Plan], tmp_path: Path
) -> None:
    again = tmp_path / "again.html"
    again.write_text("what was there before")
    motions = {method: plan.trajectory for method, plan in plans.items()}
    save_scene(lemur_capture, motions, {SHORTEST}, again)
    assert again.read_text(encoding="utf-8") == page
