"""State of the controller, for `/diagnostics`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticStatus

from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.outputs.execution import Event, Execution


@dataclass(frozen=True)
class ControllerHealth:
    """State of the controller; by default plans go out on the topic alone."""

    action: str = ""  # name of its action; empty: plans go out on the topic alone
    is_there: bool = True  # whether the action can be reached
    last: tuple[str, Event, str] | None = None  # of the last plan: id, event, words
    # Joint off its plan most, by what, and the unit
    furthest: tuple[str, float, str] | None = None


def controller_health(execution: Execution, robot: Robot) -> ControllerHealth:
    """Return the current state of the controller."""
    client = execution.controller
    return ControllerHealth(
        action="" if client is None else client.action,
        is_there=client is None or client.is_there,
        last=execution.last,
        furthest=None if client is None else _furthest(client.off, robot),
    )


def controller_part(health: ControllerHealth) -> tuple[bytes, str, Mapping[str, str]]:
    """Return level, message and values of the diagnostic status of the controller."""
    values = {"hand-over": "action" if health.action else "topic"}
    if health.last is not None:
        plan_id, event, words = health.last
        values |= {"plan id": plan_id, "event": event.name}
    if health.furthest is not None:
        joint, error, unit = health.furthest
        values |= {"joint": joint, f"off by [{unit}]": f"{error:.6f}"}
    level, message = DiagnosticStatus.OK, "plans go out on the topic joint_trajectory"
    if health.action:
        message = f"plans are sent to {health.action}"
    if health.last is not None:
        message += f"; {plan_id}: {event.name}: {words}"
    if not health.is_there:
        level = DiagnosticStatus.WARN
        message = f"nobody answers at {health.action}: does the controller run? {message}"
    if health.last is not None and event is Event.ABORTED:
        level = DiagnosticStatus.ERROR
    return level, message, values


def _furthest(off: Mapping[str, float], robot: Robot) -> tuple[str, float, str] | None:
    """Return the joint off its plan most, prismatic ones by their weight, by what, and the unit.

    A joint that no plan moves counts as revolute.
    """
    names, weights = robot.joint_names, robot.joint_weights
    numbers = {name: names.index(name) for name in off if name in names}

    def weighted(name: str) -> float:
        return off[name] * (weights[numbers[name]] if name in numbers else 1.0)

    if not off:
        return None
    joint = max(off, key=weighted)
    return joint, off[joint], robot.unit(numbers[joint]) if joint in numbers else "rad"
