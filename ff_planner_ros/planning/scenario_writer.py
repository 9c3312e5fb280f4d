"""A planning task as a scenario file, without loss: read back, it has the same digest."""

from __future__ import annotations

import math
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import yaml

from ff_planner_ros.arrays import normalising_to
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.approach import Approach
from ff_planner_ros.planning.problem import (
    Limits,
    Objective,
    Orientation,
    PlanningProblem,
    Target,
)
from ff_planner_ros.planning.scenario import Defaults, load_task
from ff_planner_ros.planning.target_body import TargetBody
from ff_planner_ros.planning.task import PlanningTask
from ff_planner_ros.robot.bodies import Geometry
from ff_planner_ros.robot.model import Base


def write_scenario(task: PlanningTask, path: Path) -> None:
    """Write a task to a scenario file, and its robot to a URDF file of the same name beside it.

    What is there is replaced.

    Raises:
        InvalidInput: The file would not hold the task: two obstacles with one id, say.
        OSError: A file cannot be written.
    """
    robot = task.problem.robot
    urdf = path.with_suffix(".urdf")
    urdf.write_text(robot.drawn_urdf, encoding="utf-8", newline="")
    content = {
        "robot": {"urdf": urdf.name, "base_link": robot.base_link, "tip_link": robot.tip_link}
        # What is written of a robot with lines has no <collision>.
        | ({} if robot.geometry is Geometry.LINES else {"geometry": robot.geometry.value})
        | ({} if robot.base is Base.FREE_FLYER else {"base": robot.base.value}),
        **described_problem(task.problem),
        **_beyond_the_problem(task),
    }
    # Flow style for what holds no other lists: a line for each vector.
    document = yaml.safe_dump(
        content, default_flow_style=None, sort_keys=False, allow_unicode=True, width=math.inf
    )
    path.write_text(document, encoding="utf-8", newline="")
    if load_task(path, Defaults(task.settings)).digest != task.digest:
        allowed = "a scenario file holds robots that their URDF describes, and their own joints"
        raise InvalidInput(Status.UNSUPPORTED, "robot or controller", "of another kind", allowed)


def described_problem(problem: PlanningProblem) -> dict[str, Any]:
    """Return a problem as a scenario has it, but for its robot."""
    start = problem.start
    accelerations = start.joint_accelerations
    return {
        "chaser": {
            "position": start.position_chaser_in_inertial.tolist(),
            "quaternion_xyzw": normalising_to(start.quaternion_chaser_to_inertial_xyzw).tolist(),
            "linear_velocity": start.linear_velocity_chaser_in_inertial.tolist(),
            "angular_velocity": start.angular_velocity_chaser_in_inertial.tolist(),
        },
        "joints": {
            "position": start.joint_positions.tolist(),
            "velocity": start.joint_velocities.tolist(),
        }
        | ({} if accelerations is None else {"acceleration": accelerations.tolist()}),
        **_goal(problem),
        "duration": _duration(problem),
        "points": int(problem.points),
        "obstacles": [
            {"id": str(sphere.id), "center": sphere.center.tolist(), "radius": sphere.radius}
            | ({"velocity": sphere.velocity.tolist()} if sphere.velocity.any() else {})
            for sphere in problem.obstacles
            if sphere.body is None
        ],
        "objective": weights_of(problem.objective),
        "limits": limits_of(problem.limits),
        "parametrisation": problem.parametrisation.value,
        **(
            {
                "allowed_at_goal": list(problem.allowed_at_goal),
                "contact_distance": float(problem.contact_distance),
            }
            if problem.allowed_at_goal
            else {}
        ),
        **described_approach(problem.approach),
    }


def limits_of(limits: Limits) -> dict[str, Any]:
    """Return limits as a scenario has them."""
    angle, accelerations = limits.chaser_attitude, limits.joint_accelerations
    return {
        "position": "from_urdf",
        "velocity": "from_urdf" if limits.joint_velocities else "none",
        "acceleration": "none" if accelerations is None else list(accelerations),
        "effort": "from_urdf" if limits.joint_torques else "none",
        "chaser_attitude": float(angle) if math.isfinite(angle) else "none",
    }


def weights_of(objective: Objective) -> dict[str, float]:
    """Return an objective as a scenario has it."""
    weights = {name: float(weight) for name, weight in asdict(objective).items()}
    return {name: weight for name, weight in weights.items() if weight or name != "duration"}


def described_approach(approach: Approach | None) -> dict[str, Any]:
    """Return an approach as a scenario has it; nothing where there is none."""
    if approach is None:
        return {}
    told = {
        "direction": approach.direction.tolist(),
        "distance": approach.distance,
        "cone": approach.cone,
    }
    return {"approach": told}


def _duration(problem: PlanningProblem) -> float | dict[str, float]:
    window = problem.duration_range
    if window is None:
        return float(problem.duration)
    return {"min": window.minimum, "max": window.maximum}


def _goal(problem: PlanningProblem) -> dict[str, Any]:
    target, body = problem.target, problem.target_body
    if body is not None:
        return {"target_body": described_body(body)}
    vectors = {item.name: getattr(target, item.name).tolist() for item in fields(Target)[:6]}
    vectors["quaternion_xyzw"] = normalising_to(target.quaternion_xyzw).tolist()
    return {"target": vectors | _orientation(target)}


def described_body(body: TargetBody) -> dict[str, Any]:
    """Return a target body as a scenario has it."""
    xx, xy, xz, _, yy, yz, _, _, zz = body.inertia.ravel().tolist()
    return {
        "position": body.position.tolist(),
        "quaternion_xyzw": normalising_to(body.quaternion_xyzw).tolist(),
        "linear_velocity": body.linear_velocity.tolist(),
        "angular_velocity": body.angular_velocity.tolist(),
        "inertia": {"ixx": xx, "ixy": xy, "ixz": xz, "iyy": yy, "iyz": yz, "izz": zz},
        "grasp": {
            "position": body.grasp_position.tolist(),
            "quaternion_xyzw": normalising_to(body.grasp_quaternion_xyzw).tolist(),
        },
        "obstacles": [
            {"id": str(sphere.id), "center": sphere.center.tolist(), "radius": sphere.radius}
            for sphere in body.obstacles
        ],
    }


def _orientation(target: Target) -> dict[str, Any]:
    """Return what counts of the orientation, where it is not all of it."""
    if target.orientation is Orientation.FIXED:
        return {}
    axis = target.free_axis_in_ee
    return {"orientation": target.orientation.value} | (
        {} if axis is None else {"free_axis": axis.tolist()}
    )


def _beyond_the_problem(task: PlanningTask) -> dict[str, Any]:
    content: dict[str, Any] = {
        "start_after": float(task.ahead),
        "end_behaviour": task.end_behaviour.value,
        "tail_duration": float(task.tail),
        "controller": "none",
        "planner": asdict(task.settings),
    }
    if task.controller is not None:
        rules = asdict(task.controller)
        del rules["joints"]
        content["controller"] = rules
    if task.running is not None:
        motion = task.running
        content["running"] = {i.name: getattr(motion, i.name).tolist() for i in fields(motion)}
    if task.running_goal is not None:
        content["running_goal"] = float(task.running_goal)
    if task.first_guess is not None:
        content["first_guess"] = task.first_guess.tolist()
    return content
