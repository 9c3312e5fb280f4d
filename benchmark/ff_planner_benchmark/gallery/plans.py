"""Our plans of the published tasks, as a user would ask for them."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from itertools import product
from typing import Any, TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

from ff_planner_benchmark.gallery.recomputed import HERE
from ff_planner_ros.common.yaml_file import read_yaml
from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.scenario.scenario import Defaults, built_task
from ff_planner_ros.planning.task.task import PlanningTask, perform

Row: TypeAlias = dict[str, Any]

SCENARIOS = HERE / "scenarios"
SOLVED = "SOLVED"
# Goals of P16: offsets of the tip's start, drawn with this seed.
_SEED, _LOWEST, _HIGHEST = 16, (-0.4, -0.3, 0.0), (0.0, 0.3, 0.3)
# How far the points of P5 are from the start, in six directions [m]: the least and the median of
# how far others reach within 2 deg; and how far the scenario's is.
_REACHES, _REACH = (0.24, 0.45), 0.45
# Engines that execute plans open loop, and their modules.
_ENGINES = {
    "MuJoCo": "ff_planner_ros.simulation.verification",
    "Drake": "ff_planner_benchmark.beside_mujoco",
    "Basilisk": "ff_planner_benchmark.third_engine",
}


@dataclass(frozen=True)
class Task:
    """A published task, as a scenario of the gallery."""

    scenario: str  # file name without its suffix
    what: str
    published: str  # the best that others have; empty: nothing


TASKS: dict[str, tuple[Task, ...]] = {
    "P1": (
        Task("p1_position", "to (1, 0) m, any heading", "turn 13.97 deg"),
        Task("p1_heading", "the same with the heading that theirs ends at", "turn 13.97 deg"),
    ),
    "P2b": (Task("p2b", "between the same ends, free path", "turn 6.88 deg, 0.242 mm"),),
    "P2c": (Task("p2c", "pose held on a tumbling target", "turn 2.44 deg, 0.0084 mm RMS"),),
    "P4": (
        Task("p4_least", "to the same angles, least largest turn", "largest turn 11.75 deg"),
        Task("p4_back", "the same, hub back where it was", "last turn 11.75 deg"),
        Task("p4_back_slow", "the same, within their accelerations", "last turn 11.75 deg"),
    ),
    "P5": (
        Task("p5_circle_300", "circle, 300 kg", "largest turn 0.198 deg, 0.162 mm RMS"),
        Task("p5_circle_30", "circle, 30 kg", "largest turn 1.94 deg, 49.7 mm RMS"),
        Task(
            "p5_circle_30_wide",
            "circle, 30 kg, within 49.7 mm",
            "largest turn 1.94 deg, 49.7 mm RMS",
        ),
    ),
    "P6": (
        Task("p6_end", "to the end of the half circle, free path", ""),
        Task("p6_half_circle", "half circle", "mean squared error 0.0041 m2, attitude 0.021"),
    ),
    "P8": (
        Task(
            "p8_three", "SC_3DoF: to the position of the given motion", "turn 8.32 deg (recomputed)"
        ),
        Task("p8_planar", "planar: to the pose of the given motion", "turn 36.13 deg (recomputed)"),
    ),
    "P9": (Task("p9", "to the pose of the given motion", "turn 1.34 deg (recomputed)"),),
    "P11": (
        Task("p11_deos", "DEOS: to the pose of one quintic a joint", "turn 14.39 deg (ours)"),
        Task("p11_tecsas", "TECSAS: to the pose of one quintic a joint", "turn 6.95 deg (ours)"),
    ),
    "P12": (Task("p12", "to the pose of one quintic a joint", "turn 15.90 deg (ours)"),),
}


def planned(task: Task, settings: PlannerSettings) -> Row:
    """Return what became of a task."""
    document = read_yaml(SCENARIOS / f"{task.scenario}.yaml")
    row: Row = {"scenario": task.scenario, "what": task.what, "published": task.published}
    return row | _attempt(document, settings, executes=True)


def reaches(settings: PlannerSettings) -> Iterator[Row]:
    """Yield the plans of P5 to points in six directions."""
    document = read_yaml(SCENARIOS / "p5_reach.yaml")
    start = np.array(document["target"]["position"]) - (_REACH, 0.0, 0.0)
    for far in _REACHES:
        for sign, axis in product((1.0, -1.0), range(3)):
            goal = (start + sign * far * np.eye(3)[axis]).tolist()
            moved = document | {"target": document["target"] | {"position": goal}}
            what = f"{far} m along {'+' if sign > 0.0 else '-'}{'xyz'[axis]}, 300 kg"
            least = "the least" if far == min(_REACHES) else "the median"
            told = f"within 2 deg: {least} of all directions"
            label: Row = {"scenario": "p5_reach", "what": what, "published": told}
            yield label | _attempt(moved, settings, executes=True)


def drawn_goals(count: int, settings: PlannerSettings) -> Iterator[Row]:
    """Yield the plans of so many goals of P16."""
    document = read_yaml(SCENARIOS / "p16.yaml")
    middle = np.array(document["target"]["position"])
    start = middle - (np.array(_LOWEST) + _HIGHEST) / 2.0
    offsets = np.random.default_rng(_SEED).uniform(_LOWEST, _HIGHEST, size=(count, 3))
    for number, goal in enumerate((start + offsets).tolist()):
        moved = document | {"target": document["target"] | {"position": goal}}
        yield {"number": number, "goal": goal} | _attempt(moved, settings, executes=False)


def _attempt(document: dict[str, Any], settings: PlannerSettings, executes: bool) -> Row:
    """Plan a scenario, and execute the plan in the engines if asked."""
    begun = _processor_time()
    try:
        task = built_task(document, SCENARIOS, Defaults(settings))
        plan = perform(task)
    except FfPlannerError as error:
        seconds = _processor_time() - begun
        return {"status": error.status.name, "message": str(error), "seconds": seconds}
    seconds = _processor_time() - begun
    executed = _flown(task, plan) if executes else {}
    return {"status": SOLVED, "seconds": seconds} | _measured(plan) | executed


def _measured(plan: Plan) -> Row:
    metrics, motion = plan.metrics, plan.trajectory
    attitudes = Rotation.from_quat(motion.chaser_quaternions_xyzw)
    turn = np.rad2deg((attitudes[0].inv() * attitudes[-1]).magnitude())

    def missed(of: str) -> float:
        """Return the largest error along a path, or else that at the goal."""
        along: float = getattr(metrics, f"max_path_{of}_error")
        at_goal: float = getattr(metrics, f"final_{of}_error")
        return along if np.isfinite(along) else at_goal

    return {
        "turn_deg": float(turn),
        "peak_deg": float(np.rad2deg(metrics.max_chaser_rotation)),
        "position_mm": 1e3 * missed("position"),
        "attitude_deg": float(np.rad2deg(missed("orientation"))),
        "path_rad": metrics.joint_path_length,
    }


def _flown(task: PlanningTask, plan: Plan) -> Row:
    """Return the largest deviation of end effector or chaser in each engine that is installed."""
    robot, motion, row = task.problem.robot, plan.trajectory, Row()
    for engine, module in _ENGINES.items():
        try:
            execute = import_module(module)
            off = (
                execute.verify(robot, motion).deviation
                if engine == "MuJoCo"
                else execute.flown(robot, motion, Scene(), 1).deviation
            )
        except FfPlannerError:
            continue  # it is not installed, or cannot execute the plan
        worst = max(off.final_position_error, off.max_chaser_position_error)
        row[engine] = 1e3 * float(worst)
    return row


def _processor_time() -> float:
    """Return the processor time of this process and of those that it has waited for [s]."""
    used = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(one.ru_utime + one.ru_stime for one in used)
