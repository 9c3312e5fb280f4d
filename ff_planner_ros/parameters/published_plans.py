"""Parameters of published plans: allowed deviations of the system, and handover to a new plan."""

from __future__ import annotations

from dataclasses import dataclass

from ff_planner_ros.planning.problem.settings import STRICT_IF_LOW, tunable


@dataclass(frozen=True)
class TrackingParameters:
    """When diagnostics warn that the chaser leaves the plan."""

    max_position: float = tunable(
        "Distance between the measured and the predicted chaser, above which diagnostics warn",
        0.0,
        None,
        "m",
        STRICT_IF_LOW,
    )
    max_angle: float = tunable(
        "Angle between the measured and the predicted attitude of the chaser, above which "
        "diagnostics warn",
        minimum=0.0,
        unit="rad",
        strictness=STRICT_IF_LOW,
    )


@dataclass(frozen=True)
class PublicationParameters:
    """Allowed deviations from a plan's first point at its start, if it is published on request."""

    max_position: float = tunable(
        "At ~/publish_plan: allowed distance of the chaser, carried forward from the latest state "
        "to the plan's start, from the plan's first point",
        minimum=0.0,
        unit="m",
        strictness=STRICT_IF_LOW,
    )
    max_angle: float = tunable(
        "At ~/publish_plan: allowed angle between the chaser's attitude and that of the "
        "plan's first point",
        0.0,
        None,
        "rad",
        STRICT_IF_LOW,
    )
    max_velocity: float = tunable(
        "At ~/publish_plan: allowed difference of the chaser's velocity from that of the "
        "plan's first point",
        0.0,
        None,
        "m/s",
        STRICT_IF_LOW,
    )
    max_angular_velocity: float = tunable(
        "At ~/publish_plan: allowed difference of the chaser's angular velocity from that of the "
        "plan's first point",
        minimum=0.0,
        unit="rad/s",
        strictness=STRICT_IF_LOW,
    )
    max_joint_position: float = tunable(
        "At ~/publish_plan: allowed difference of each joint's position from that of the "
        "plan's first point",
        0.0,
        None,
        "rad",
        STRICT_IF_LOW,
    )
    max_joint_velocity: float = tunable(
        "At ~/publish_plan: allowed difference of each joint's velocity from that of the "
        "plan's first point",
        0.0,
        None,
        "rad/s",
        STRICT_IF_LOW,
    )
    max_age: float = tunable(
        "Age above which a waiting plan is not published", 0.0, None, "s", STRICT_IF_LOW
    )


@dataclass(frozen=True)
class ReplanningParameters:
    """How a plan takes over from the one that runs, where `replan_active` asks for that."""

    lead_time: float = tunable(
        "Time from a request to the handover, if the request has no start_time; it must cover "
        "planning, and what the controller needs to take over",
        minimum=0.0,
        maximum=3600.0,
        unit="s",
    )
    handover: float = tunable(
        "A plan that is not ready this long before the handover is refused: it must reach the "
        "controller by then",
        minimum=0.0,
        maximum=3600.0,
        unit="s",
    )
    min_remainder: float = tunable(
        "A request is refused if the running plan reaches its goal sooner than this after the "
        "handover",
        minimum=0.001,
        maximum=3600.0,
        unit="s",
    )
    max_position: float = tunable(
        "Distance of the measured chaser from the running plan, above which a request is refused",
        minimum=0.0,
        unit="m",
        strictness=STRICT_IF_LOW,
    )
    max_angle: float = tunable(
        "Angle between the measured attitude and that of the running plan, above which a request "
        "is refused",
        0.0,
        None,
        "rad",
        STRICT_IF_LOW,
    )
    max_joint_position: float = tunable(
        "Difference between a measured joint and the running plan, above which a request is "
        "refused",
        0.0,
        None,
        "rad",
        STRICT_IF_LOW,
    )
