"""Trajectory planning for free-floating space manipulators: the public Python interface.

A name is imported when it is first used, so that `import ff_planner_ros` costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ff_planner_ros.analysis.drawing.figures import plot_plan as plot_plan
    from ff_planner_ros.common.share import share_directory as share_directory
    from ff_planner_ros.errors import FfPlannerError as FfPlannerError
    from ff_planner_ros.errors import InvalidInput as InvalidInput
    from ff_planner_ros.errors import NoPlanFound as NoPlanFound
    from ff_planner_ros.parameters import load_parameters as load_parameters
    from ff_planner_ros.planning.motion.metrics import Metrics as Metrics
    from ff_planner_ros.planning.motion.plan import Plan as Plan
    from ff_planner_ros.planning.motion.plan import Trajectory as Trajectory
    from ff_planner_ros.planning.problem.approach import Approach as Approach
    from ff_planner_ros.planning.problem.camera import Camera as Camera
    from ff_planner_ros.planning.problem.obstacles import Obstacle as Obstacle
    from ff_planner_ros.planning.problem.obstacles import RigidMotion as RigidMotion
    from ff_planner_ros.planning.problem.problem import DurationRange as DurationRange
    from ff_planner_ros.planning.problem.problem import Limits as Limits
    from ff_planner_ros.planning.problem.problem import Objective as Objective
    from ff_planner_ros.planning.problem.problem import PlanningProblem as PlanningProblem
    from ff_planner_ros.planning.problem.problem import Target as Target
    from ff_planner_ros.planning.problem.problem import with_capture_target as with_capture_target
    from ff_planner_ros.planning.problem.settings import PlannerSettings as PlannerSettings
    from ff_planner_ros.planning.problem.target_body import AttachedObstacle as AttachedObstacle
    from ff_planner_ros.planning.problem.target_body import TargetBody as TargetBody
    from ff_planner_ros.planning.scenario.scenario import Defaults as Defaults
    from ff_planner_ros.planning.scenario.scenario import load_scenario as load_scenario
    from ff_planner_ros.planning.scenario.scenario import load_task as load_task
    from ff_planner_ros.planning.task.tail import EndBehaviour as EndBehaviour
    from ff_planner_ros.planning.task.task import PlanningTask as PlanningTask
    from ff_planner_ros.planning.task.task import perform as perform
    from ff_planner_ros.robot.collision.geometry import Geometry as Geometry
    from ff_planner_ros.robot.collision.solids import Solid as Solid
    from ff_planner_ros.robot.model import Robot as Robot
    from ff_planner_ros.robot.model import load_robot as load_robot
    from ff_planner_ros.robot.state import SystemState as SystemState
    from ff_planner_ros.simulation.verification import Verification as Verification
    from ff_planner_ros.simulation.verification import verify as simulate_plan  # noqa: F401

_MODULES = {
    "planning.scenario.scenario": ("load_scenario", "load_task", "Defaults"),
    "parameters": ("load_parameters",),
    "planning.task.task": ("PlanningTask", "perform"),
    "planning.problem.problem": (
        *("PlanningProblem", "Target", "Objective", "Limits"),
        "DurationRange",
        "with_capture_target",
    ),
    "planning.problem.obstacles": ("Obstacle", "RigidMotion"),
    "robot.collision.solids": ("Solid",),
    "planning.problem.approach": ("Approach",),
    "planning.problem.camera": ("Camera",),
    "planning.problem.target_body": ("TargetBody", "AttachedObstacle"),
    "robot.model": ("Robot", "load_robot"),
    "robot.collision.geometry": ("Geometry",),
    "robot.state": ("SystemState",),
    "planning.problem.settings": ("PlannerSettings",),
    "planning.task.tail": ("EndBehaviour",),
    "planning.motion.plan": ("Plan", "Trajectory"),
    "planning.motion.metrics": ("Metrics",),
    "simulation.verification": ("simulate_plan", "Verification"),
    "analysis.drawing.figures": ("plot_plan",),
    "common.share": ("share_directory",),
    "errors": ("FfPlannerError", "InvalidInput", "NoPlanFound"),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}
_NAME_THERE = {"simulate_plan": "verify"}
__all__ = [*_MODULE_OF]


def __dir__() -> list[str]:
    """List the public names, for `dir`, `help` and completion."""
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})


def __getattr__(name: str) -> Any:
    """Import a public name from its module.

    Raises:
        AttributeError: It is no public name.
    """
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = import_module(f"{__name__}.{_MODULE_OF[name]}")
    return getattr(module, _NAME_THERE.get(name, name))
