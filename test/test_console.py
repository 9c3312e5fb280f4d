"""The console without a browser: what is drawn is where it is, and changes are what was meant."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace
from threading import Event
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import viser
from ff_planner_msgs.msg import PlanEvent, PublishedPlan
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from ff_planner_ros.analysis.drawing.obstacle_surfaces import placed
from ff_planner_ros.analysis.drawing.solids import robot_surface, surface_at
from ff_planner_ros.analysis.nearest import nearest
from ff_planner_ros.common.share import share_directory
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.console import search
from ff_planner_ros.console.changes import GOAL, lasting_for, movable, moved, weighted
from ff_planner_ros.console.entries import Entry, entry_of, in_words, table_of
from ff_planner_ros.console.faults import place_of_fault
from ff_planner_ros.console.live.link import Link
from ff_planner_ros.console.live.plans import Plans, _Known
from ff_planner_ros.console.page import Page
from ff_planner_ros.console.parts import CHASER, TARGET, Part, obstacle_parts, robot_parts
from ff_planner_ros.console.search import Answer, Search
from ff_planner_ros.console.serve import Served, serve
from ff_planner_ros.console.stages import at_time, stages_of
from ff_planner_ros.errors import FfPlannerError, InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import Objective
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.ros.messages.to_messages import time_message
from ff_planner_ros.ros.outputs.made_plan import MadePlan

SCENARIOS = share_directory() / "config" / "scenarios"


def task_of(name: str) -> PlanningTask:
    return load_task(SCENARIOS / f"{name}.yaml", Defaults(load_parameters().planner))


@pytest.fixture(scope="module")
def capture() -> PlanningTask:
    """The paper's capture, of a robot with bodies."""
    return task_of("lemur_capture_bodies")


@pytest.fixture(scope="module")
def plan(capture: PlanningTask) -> Plan:
    return perform(capture)


@pytest.fixture
def page(capture: PlanningTask) -> Iterator[Page]:
    served: Served = serve(
        lambda server: Page(server, [Entry("capture", capture)]), "127.0.0.1", 8500
    )
    yield served.page
    served.server.stop()


def corners_at(part: Part, point: int) -> np.ndarray:
    w, x, y, z = part.quaternions_wxyz[point]
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    return part.corners @ turn.T + part.positions[point]


def as_set(points: np.ndarray) -> set[tuple[float, ...]]:
    return set(map(tuple, np.round(points, 6).tolist()))


def test_the_robots_parts_are_where_its_surface_is(capture: PlanningTask, plan: Plan) -> None:
    (stage,) = stages_of(capture, plan)
    robot, parts = stage.problem.robot, list(robot_parts(stage.problem.robot, stage.q))
    assert parts[0].kind == CHASER
    surface = robot_surface(robot)
    for point in (0, 17, len(stage.times) - 1):
        drawn = np.concatenate([corners_at(part, point) for part in parts])
        whole = surface_at(robot, surface, stage.q[[point]])[0][np.unique(surface.triangles)]
        assert np.linalg.norm(drawn[:, None] - whole[None, ::97], axis=2).min(axis=0).max() < 1e-9
        assert len(drawn) == len(whole)


@pytest.mark.parametrize("scenario", ["lemur_capture", "lemur_capture_bodies", "panel_capture"])
def test_every_surface_that_is_drawn_looks_outwards(scenario: str) -> None:
    """The page draws no backs."""
    (stage,) = stages_of(task_of(scenario), None)
    for part in (*robot_parts(stage.problem.robot, stage.q), *obstacle_parts(stage)):
        edges = np.concatenate([part.triangles[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
        touching = coo_array((np.ones(len(edges)), edges.T), (len(part.corners),) * 2)
        solids, of_corner = connected_components(touching, directed=False)
        volumes = np.zeros(solids)
        corners = part.corners[part.triangles]
        np.add.at(volumes, of_corner[part.triangles[:, 0]], np.linalg.det(corners) / 6.0)
        used = np.unique(of_corner[part.triangles])
        assert volumes[used].min() > 1e-7, part.name


def test_ghosts_stand_at_both_ends_of_a_plan_and_nowhere_before_there_is_one(
    page: Page, capture: PlanningTask, plan: Plan
) -> None:
    assert page._scene._ghosts == {}
    stages = stages_of(capture, plan)
    page._scene.show(stages)
    for time, visible in (
        (0.0, [False, True]),
        (stages[-1].end / 2, [True, True]),
        (stages[-1].end, [True, False]),
    ):
        page._scene.move_to(time)
        assert [ghost.visible for ghost in page._scene._ghosts.values()] == visible
    for (number, point), ghost in page._scene._ghosts.items():
        parts = robot_parts(stages[number].problem.robot, stages[number].q)
        true = np.concatenate([corners_at(part, point) for part in parts])
        assert ghost.vertices == pytest.approx(true, abs=1e-5)


def test_what_is_fixed_to_a_target_moves_with_it() -> None:
    task = task_of("panel_capture")
    (stage,) = stages_of(task, None)
    parts = {part.name: part for part in obstacle_parts(stage)}
    for one in stage.problem.obstacles:
        part = parts[one.id]
        assert part.kind == TARGET
        true = placed(one, part.corners, stage.times[[-1]])[0]
        assert corners_at(part, -1) == pytest.approx(true, abs=1e-9)
        assert np.abs(true - placed(one, part.corners, stage.times[[0]])[0]).max() > 0.01


def test_phases_are_one_motion_and_what_is_caught_goes_on_with_the_arm() -> None:
    task = task_of("whole_capture")
    made = perform(task)
    stages = stages_of(task, made)
    ends = np.cumsum([float(one.trajectory.time[-1]) for one in made.phases])
    assert [stage.begin for stage in stages] == pytest.approx([0.0, *ends[:-1]])
    chasers = [next(robot_parts(stage.problem.robot, stage.q)) for stage in stages]
    for before, after in itertools.pairwise(chasers):
        assert after.positions[0] == pytest.approx(before.positions[-1], abs=1e-9)
    caught = [corners_at(part, -1) for part in obstacle_parts(stages[0]) if part.kind == TARGET]
    held = np.concatenate(
        [corners_at(part, 0) for part in robot_parts(stages[1].problem.robot, stages[1].q)]
    )
    for body in caught:
        low, high = body.min(axis=0), body.max(axis=0)
        inside = held[((held > low - 1e-3) & (held < high + 1e-3)).all(axis=1)]
        assert inside.min(axis=0) == pytest.approx(low, abs=0.02)
        assert inside.max(axis=0) == pytest.approx(high, abs=0.02)
    middle = float(ends[0])
    assert at_time(stages, middle - 1e-3) == (0, len(stages[0].times) - 1)
    assert at_time(stages, middle + 1e-3) == (1, 0)
    assert at_time(stages, 1e9) == (len(stages) - 1, len(stages[-1].times) - 1)


def test_the_nearest_pair_of_all_points_is_the_plans(capture: PlanningTask, plan: Plan) -> None:
    (stage,) = stages_of(capture, plan)
    problem = capture.problem
    moving = [
        one.with_motion(velocity=np.array([0.03, 0.0, 0.0])) if one.is_sphere else one
        for one in problem.obstacles
    ]
    stage = replace(stage, problem=replace(problem, obstacles=tuple(moving)))
    least = min(
        (near for point in range(len(stage.times)) if (near := stage.nearest(point))),
        key=lambda near: near.distance,
    )
    true = nearest(problem.robot, plan.trajectory, stage.problem.obstacles)
    assert true is not None
    assert (least.pair, least.distance) == (true.pair, pytest.approx(true.distance, abs=1e-9))


def test_what_may_touch_at_the_goal_is_told_so() -> None:
    task = task_of("panel_capture")
    (stage,) = stages_of(task, None)
    link, obstacle = task.problem.allowed_collisions[0].split("/")
    assert stage.may_touch(f"{link}#1/{obstacle}")
    assert stage.may_touch(f"{link}/{obstacle}")
    assert not stage.may_touch(f"link_1/{obstacle}")
    assert not stage.may_touch(f"{link}/{obstacle}_2")


def test_a_moved_goal_is_reached(capture: PlanningTask) -> None:
    place = capture.problem.target.position + np.array([0.0, 0.05, 0.02])
    made = perform(moved(capture, GOAL, place))
    assert made.trajectory.ee_positions[-1] == pytest.approx(place, abs=1e-5)


def test_a_moved_obstacle_is_there_and_others_stay(capture: PlanningTask) -> None:
    problem = capture.problem
    name = problem.obstacles[1].id
    place = np.array([3.0, 2.0, 1.0])
    after = moved(capture, name, place).problem
    for before, one in zip(problem.obstacles, after.obstacles, strict=True):
        assert one.center == pytest.approx(place if one.id == name else before.center)
    with pytest.raises(InvalidInput, match="moved is nobody: it must be one of goal, "):
        moved(capture, "nobody", place)


def test_a_grasp_and_what_is_fixed_to_the_target_cannot_be_moved() -> None:
    assert movable(task_of("panel_capture").problem) == ()
    assert GOAL not in movable(task_of("stow").problem)


def test_the_grasp_after_another_duration_is_where_the_body_is_then() -> None:
    task = task_of("panel_capture")
    body = task.problem.target_body
    assert body is not None
    longer = lasting_for(task, 20.0, 20.0).problem
    true = body.grasp(np.array([20.0])).positions[0]
    assert longer.duration == 20.0
    assert longer.target.position == pytest.approx(true)
    assert len(longer.obstacles) == len(task.problem.obstacles)


def test_a_change_leaves_nothing_of_the_old_search(capture: PlanningTask) -> None:
    changed = weighted(replace(capture, effort=5, first_guess=np.ones(3)), 1.0, 2.0)
    assert (changed.effort, changed.first_guess) == (0, None)
    assert changed.problem.objective.chaser_attitude == 2.0
    with pytest.raises(InvalidInput, match="one weight must be positive"):
        weighted(capture, 0.0, 0.0)


def in_collision(task: PlanningTask) -> PlanningTask:
    tip = stages_of(task, None)[0].tip[0]
    return moved(task, task.problem.obstacles[0].id, tip)


def test_a_start_in_collision_is_marked_where_it_is(capture: PlanningTask) -> None:
    task = in_collision(capture)
    with pytest.raises(FfPlannerError) as refused:
        perform(task)
    place = place_of_fault(task, refused.value)
    assert place is not None
    assert refused.value.status is Status.START_IN_COLLISION
    sphere = task.problem.obstacles[0]
    assert f"/{sphere.id}, -" in place.words
    assert np.linalg.norm(place.points.mean(axis=0) - sphere.center) < 2 * sphere.radius


def test_a_goal_out_of_reach_is_marked(capture: PlanningTask) -> None:
    task = moved(capture, GOAL, np.array([30.0, 0.0, 0.0]))
    with pytest.raises(NoPlanFound) as refused:
        perform(task)
    assert refused.value.status is Status.GOAL_OUT_OF_REACH
    place = place_of_fault(task, refused.value)
    assert place is not None
    assert place.points[-1] == pytest.approx([30.0, 0.0, 0.0])


@pytest.mark.parametrize("kept", ["torques", "velocities"])
def test_a_joint_beyond_its_limit_is_marked_where_and_when_it_is(
    capture: PlanningTask, kept: str
) -> None:
    quick = replace(capture.settings, starts=1)
    task = replace(lasting_for(capture, 0.5, 0.5), settings=quick)
    limits = replace(
        task.problem.limits, joint_torques=kept == "torques", joint_velocities=kept != "torques"
    )
    task = replace(task, problem=replace(task.problem, limits=limits, obstacles=()))
    with pytest.raises(NoPlanFound) as refused:
        perform(task)
    place, attempt = place_of_fault(task, refused.value), refused.value.attempt
    assert place is not None
    assert isinstance(attempt, Plan)
    robot, motion = task.problem.robot, attempt.trajectory
    shares = {
        "torques": np.abs(motion.joint_torques) / robot.effort_limits,
        "velocities": np.abs(motion.joint_velocities) / robot.velocity_limits,
    }[kept]
    point = int(np.abs(motion.time - place.time).argmin())
    joint = robot.joint_names.index(place.words)
    assert shares[point, joint] > 1.0
    assert shares[point, joint] > 0.95 * shares.max()
    assert refused.value.failures[0].finding.startswith(f"joint {place.words} ")
    origin = stages_of(task, attempt)[0].q[point]
    assert place.points[0] == pytest.approx(arm_points(robot, origin[None])[0, joint], abs=1e-9)


def test_a_search_gives_the_plan_that_the_task_has(capture: PlanningTask, plan: Plan) -> None:
    answers = list[Answer]()
    Search(capture, list[str]().append, answers.append).wait()
    (answer,) = answers
    assert answer.plan is not None
    assert np.array_equal(answer.plan.trajectory.joint_positions, plan.trajectory.joint_positions)


def test_a_search_that_goes_on_tells_of_its_best_plan(capture: PlanningTask) -> None:
    problem = replace(capture.problem, objective=Objective(1.0, 1.0))
    told = list[str]()
    Search(replace(capture, problem=problem), told.append, list[Answer]().append).wait()
    assert any("best so far: joint path length" in words for words in told)


def test_a_cancelled_search_ends_at_its_next_step(capture: PlanningTask) -> None:
    answers, begun, cancelled = list[Answer](), Event(), Event()

    def told(_: str) -> None:
        begun.set()
        cancelled.wait()

    running = Search(lasting_for(capture, 0.5, 0.5), told, answers.append)
    begun.wait()
    running.cancel()
    cancelled.set()
    running.wait()
    (answer,) = answers
    assert answer.cancelled
    entry = entry_of("plan 1", answer)
    assert (entry.status, entry.plan) == ("cancelled", None)


def test_the_table_has_the_metrics_of_every_answer(capture: PlanningTask, plan: Plan) -> None:
    planned = Entry("<b>", capture, plan, status="planned")
    refused = Entry("second", None, status="refused, BUSY", words="<script>")
    table = table_of([planned, refused], planned)
    assert f"<td>{plan.metrics.joint_path_length:.4f}</td>" in table
    assert ">second: refused, BUSY</td><td>-</td>" in table
    assert "<tr class='chosen'><td>&lt;b&gt;</td>" in table
    assert "&lt;script&gt;" in in_words(refused)


def test_the_objective_is_what_the_weights_make_of_the_metrics(
    capture: PlanningTask, plan: Plan
) -> None:
    entry = Entry("plan", weighted(capture, 2.0, 3.0), plan)
    value = 2.0 * plan.metrics.joint_path_length + 3.0 * plan.metrics.max_chaser_euler
    assert entry.objective == f"{value:.4f}"


def test_a_page_plans_what_was_changed_and_goes_back_to_an_answer(page: Page) -> None:
    first = page.chosen.task
    assert first is not None
    page.move(GOAL, first.problem.target.position + np.array([0.0, 0.05, 0.0]), None)
    changed = page.task
    assert changed is not None
    assert changed is not first
    page.plan()
    while page.search is not None:
        page.search.wait()
    assert page.chosen.plan is not None
    end = page.chosen.plan.trajectory.ee_positions[-1]
    assert end == pytest.approx(changed.problem.target.position, abs=1e-5)
    page.choose("capture")
    assert page.task is first


def test_what_is_changed_during_a_search_is_kept_and_can_be_planned(page: Page, plan: Plan) -> None:
    """The answer of the search is in the table."""
    searches: list[tuple[PlanningTask, Callable[[Entry], None]]] = []

    def begin(task: PlanningTask, _told: object, done: Callable[[Entry], None]) -> Any:
        searches.append((task, done))
        return SimpleNamespace()

    page._begin = begin
    asked = page.task
    assert asked is not None
    page.plan()
    changed = lasting_for(asked, 1.5 * asked.problem.duration, 1.5 * asked.problem.duration)
    page.change(changed)
    ((task, done),) = searches
    done(Entry("plan 0", task, plan, status="planned"))
    assert page.task is changed
    assert page._progress.content == "changed: not planned yet"
    assert not page._undo.disabled
    assert "plan 0" in [one.name for one in page.entries]
    page.plan()
    assert searches[-1][0] is changed
    searches[-1][1](Entry("last", changed, plan, status="planned"))
    assert page.chosen.name == "last"
    assert page._undo.disabled


def test_an_entry_that_comes_anew_leaves_what_is_changed(page: Page, plan: Plan) -> None:
    assert page.task is not None
    changed = weighted(page.task, 1.0, 2.0)
    page.change(changed)
    page.put(Entry("capture", page.chosen.task, plan, status="planned"))
    assert page.task is changed
    page.choose("capture")
    assert page.chosen.plan is plan


def test_a_page_tells_a_change_that_is_refused_and_keeps_the_task(page: Page) -> None:
    before = page.task
    page.move(GOAL, np.array([np.nan, 0.0, 0.0]), None)
    assert page.task is before
    assert "not changed: target.position" in page._progress.content


def test_a_handle_moves_the_goal_where_it_is_let_go_and_turns_it(page: Page) -> None:
    assert page.task is not None
    before = page.task.problem.target
    page._move.value = GOAL
    page._place_handle()
    assert page._handle is not None
    assert page._handle.position == pytest.approx(before.position)
    turned = Rotation.from_quat(before.quaternion_xyzw) * Rotation.from_rotvec([0.1, 0.0, 0.0])
    x, y, z, w = turned.as_quat()
    place = before.position + np.array([0.0, 0.03, 0.0])
    held = SimpleNamespace(position=place, wxyz=np.array([w, x, y, z]))
    page._moved_by_handle(SimpleNamespace(phase="update", target=held))
    assert page.task.problem.target is before
    page._moved_by_handle(SimpleNamespace(phase="end", target=held))
    after = page.task.problem.target
    assert after.position == pytest.approx(place, abs=1e-4)
    between = Rotation.from_quat(after.quaternion_xyzw) * turned.inv()
    assert between.magnitude() == pytest.approx(0.0, abs=1e-9)


def test_undo_goes_back_and_weights_alone_leave_the_picture(page: Page) -> None:
    before, drawn = page.task, page._scene._drawn
    assert before is not None
    page.change(weighted(before, 1.0, 2.0), is_elsewhere=False)
    assert page._scene._drawn is drawn
    page.choose(page.chosen.name)
    assert page.task is before


def test_a_page_draws_at_most_one_motion_however_often_it_changes(page: Page) -> None:
    assert page.task is not None
    for _ in range(3):
        page.change(page.task)
    nodes = set(page._server.scene._handle_from_node_name)
    page.change(page.task)
    assert set(page._server.scene._handle_from_node_name) == nodes


def test_no_public_address_is_asked_for(page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viser._viser, "ViserTunnel", None)
    assert page._server.request_share_url() is None


def test_a_defect_ends_a_search_with_words(
    capture: PlanningTask, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(search, "perform", lambda *_: 1 // 0)
    answers = list[Answer]()
    Search(capture, lambda _: None, answers.append).wait()
    assert answers[0].error is not None
    assert answers[0].error.status is Status.INTERNAL_ERROR
    assert "ZeroDivisionError" in str(answers[0].error)


@pytest.mark.parametrize("previous", ["run.1", "", "run.0"])
def test_a_console_knows_which_plan_runs_until_the_next_one_begins(
    capture: PlanningTask, plan: Plan, previous: str
) -> None:
    """That which the node says, if it was the last one; of two that it published none else."""
    link = SimpleNamespace(published=None, now_ns=lambda: 0, parameters=load_parameters())
    plans, made = Plans(cast(Link, link), lambda _: None), dict[str, MadePlan]()
    scene = scene_of(capture.problem)
    for plan_id, start, before in (("run.1", 9.0, ""), ("run.2", 5.0, previous)):
        start_ns = round(start * NANOSECONDS)
        told = capture.problem.robot, scene, "inertial", before
        made[plan_id] = MadePlan(plan_id, plan, start_ns, "none", *told)
        plans._known[plan_id] = _Known(
            Entry(plan_id, capture, plan, plan_id=plan_id), made[plan_id]
        )
        plans.published(PublishedPlan(plan_id=plan_id, start_time=time_message(start_ns)))
    found: Any = link.published
    assert (found.plan_id, found.start_ns) == ("run.2", 5 * NANOSECONDS)
    assert (found.before is not None) == (previous == "run.1")
    assert found.at(4 * NANOSECONDS) is None
    for plan_id in ("run.1", "run.2"):
        assert link.published is found
        plans.happened(PlanEvent(plan_id=plan_id, event=PlanEvent.ABORTED, message="because"))
    assert link.published is None
