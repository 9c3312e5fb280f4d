"""Parameters of published plans: allowed deviations of the system, and handover to a new plan."""

from __future__ import annotations

from dataclasses import dataclass

from ff_planner_ros.common.declared import tunable


@dataclass(frozen=True)
class TrackingParameters:
    """How far the system may be from where a plan has it.

    `/diagnostics` warn of more, replanning is refused, a plan that waits is not published, and the
    joints are not taken to follow the plan.
    """

    max_position: float = tunable(
        0.02, "Allowed distance of the chaser from where the plan has it [m]"
    )
    max_angle: float = tunable(
        0.02, "Allowed angle between the chaser's attitude and that of the plan [rad]"
    )
    max_velocity: float = tunable(
        0.01, "Allowed difference of its velocity, where a plan that waits is to begin [m/s]"
    )
    max_angular_velocity: float = tunable(
        0.01, "Allowed difference of its angular velocity, likewise [rad/s]"
    )
    max_joint_position: float = tunable(
        0.02,
        "Allowed difference of each joint's position from that of the plan; joints within it "
        "follow the plan until the next one starts, others keep their measured velocities [rad]",
    )
    max_joint_velocity: float = tunable(
        0.02,
        "Allowed difference of each joint's velocity, where a plan that waits is to begin [rad/s]",
    )


@dataclass(frozen=True)
class PublicationParameters:
    """Plans that wait to be published on request."""

    max_age: float = tunable(600.0, "Age above which a waiting plan is not published [s]")


@dataclass(frozen=True)
class ReplanningParameters:
    """How a plan takes over from the one that runs, where `replan_active` asks for that."""

    lead_time: float = tunable(
        0.2,
        "Time from a request to the handover, if the request has no start_time [s]",
        (0.0, 3600.0),
    )
    handover: float = tunable(
        0.05, "A plan that is not ready this long before the handover is refused [s]", (0.0, 3600.0)
    )
    min_remainder: float = tunable(
        0.3,
        "A request is refused if the running plan reaches its goal this soon after the handover "
        "[s]",
        (0.001, 3600.0),
    )
