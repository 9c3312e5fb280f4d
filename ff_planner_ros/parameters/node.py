"""Every parameter of the node, declared once: type, unit, range, default and meaning."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from ff_planner_ros.common.declared import tunable
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.common.yaml_file import yaml_document
from ff_planner_ros.parameters.controller import ControllerParameters
from ff_planner_ros.parameters.interfaces import (
    BagParameters,
    OdometryParameters,
    RateParameters,
    TransformParameters,
)
from ff_planner_ros.parameters.published_plans import (
    PublicationParameters,
    ReplanningParameters,
    TrackingParameters,
)
from ff_planner_ros.parameters.robot import LimitParameters, RobotParameters
from ff_planner_ros.planning.motion.watch import Budget
from ff_planner_ros.planning.problem.problem import MAX_POINTS, MIN_POINTS
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.problem.user_requirements import requirements_read
from ff_planner_ros.planning.requirements.requirement import Requirement
from ff_planner_ros.planning.scenario.scenario import Defaults
from ff_planner_ros.planning.task.tail import EndBehaviour

# Values of when_busy: what happens if a request arrives during another one.
REJECT, PREEMPT = "reject", "preempt"
# So much that the age does not matter [s]: more than the time since 1970, of what is not stamped.
ANY_AGE = 1e10
STATE_SOURCES = ("chaser_state", "odometry")


@dataclass(frozen=True)
class NodeParameters:
    """Every parameter of the node; full names of grouped ones are GROUP.FIELD.

    Raises:
        InvalidInput: A plug-in's requirement is refused.
    """

    robot: RobotParameters
    limits: LimitParameters
    odometry: OdometryParameters
    controller: ControllerParameters
    tracking: TrackingParameters
    publication: PublicationParameters
    replanning: ReplanningParameters
    rates: RateParameters
    tf: TransformParameters
    bag: BagParameters
    planner: PlannerSettings
    library: str = tunable(
        "",
        "Library of plans (file or directory) whose nearest plan is the first guess; empty: none",
        key="planner.library",
    )
    plug_ins: str = tunable(
        "",
        "Requirements of plug-ins that plans must keep, as YAML `name: {values}`; empty: none",
        key="planner.plugins",
    )
    autostart: bool = tunable(
        True, "Whether the node configures and activates itself; if not, a lifecycle manager does"
    )
    allow_remote_paths: bool = tunable(
        False,
        "Whether robot.urdf, robot.srdf, robot.xacro_arguments, bag.directory and planner.library "
        "may be set over ROS while the node is unconfigured",
    )
    inertial_frame: str = tunable(
        "inertial", "frame_id that states, obstacles and targets must carry"
    )
    state_source: str = tunable(
        "chaser_state",
        "Source of the state: chaser_state, or odometry (with joint_states)",
        words=STATE_SOURCES,
    )
    state_synchronization: float = tunable(
        0.01,
        "Largest difference between the stamps of odometry and of the joint_states that make a "
        "state with it; each joint may have a message of its own [s]",
        (0.0, 1.0),
    )
    points: int = tunable(
        50,
        "Number of points of a trajectory, if the request does not say",
        (MIN_POINTS, MAX_POINTS),
    )
    time_budget: float = tunable(
        30.0,
        "Wall-clock time from a request to its answer, if the request does not say [s]",
        (0.001, 86_400.0),
    )
    attitude_time_budget: float = tunable(
        3.0,
        "Likewise if the attitude has a weight: then the best plan so far is the answer [s]",
        (0.001, 86_400.0),
    )
    planning_lead_time: float = tunable(
        10.0,
        "Time from a request to its plan's start, if the request does not say [s]",
        (0.0, 3600.0),
    )
    start_horizon: float = tunable(
        600.0,
        "Largest time from now to a start time; a later start is refused [s]",
        (0.0, 86_400.0),
    )
    when_busy: str = tunable(
        "reject",
        "For a request during another one: reject answers BUSY, preempt ends the other one",
        words=(REJECT, PREEMPT),
    )
    end_behaviour: str = tunable(
        "stop_joints",
        "After the goal, if the request does not say: none, hold_end_effector or stop_joints",
        words=EndBehaviour,
    )
    post_goal_duration: float = tunable(
        2.0, "Duration of the end behaviour; without effect for none [s]", (0.001, 3600.0)
    )
    state_max_age: float = tunable(
        0.5, "Age above which a chaser state is refused [s]", (0.0, 3600.0)
    )
    state_future_tolerance: float = tunable(
        0.05, "A stamp of a state or target body further ahead of now is refused [s]", (0.0, 3600.0)
    )
    allow_several_publishers: bool = tunable(
        False,
        "Whether a state, scene or target body may have several publishers, whose messages then "
        "count in turn; if not, a second one is refused by name. joint_states may have one for "
        "each joint in any case",
    )
    locked_joint_tolerance: float = tunable(
        0.02,
        "Allowed position error, and allowed rate, of a joint that the model has locked; a state "
        "that exceeds it is refused [rad, m, rad/s, m/s]",
    )
    target_max_age: float = tunable(
        5.0,
        "Age above which a target body is refused; a younger one is carried forward [s]",
        (0.0, 3600.0),
    )

    obstacles_max_age: float = tunable(
        5.0,
        "Age above which moving obstacles are refused; younger ones are carried forward [s]",
        (0.0, ANY_AGE),
    )

    FACTS = ("robot", "time_budget", "points", "end_behaviour")
    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Check the plug-ins' requirements, which are refused here, not with the first request."""
        _ = self.requirements

    @cached_property
    def requirements(self) -> tuple[Requirement, ...]:
        """Requirements of plug-ins that plans must keep beside the planner's own.

        Raises:
            InvalidInput: `plug_ins` is no YAML, or a plug-in is not installed or refuses its part.
        """
        if not self.plug_ins.strip():
            return ()
        document = yaml_document(self.plug_ins, "planner.plugins", "no YAML")
        return requirements_read("planner.plugins", document)

    def budget(self, attitude_counts: bool) -> Budget:
        """Return the time budget of a request that gives none.

        Args:
            attitude_counts: Whether the chaser's attitude has a weight in the objective.
        """
        return Budget(self.time_budget, self.attitude_time_budget if attitude_counts else math.inf)

    def of_scenarios(self) -> Defaults:
        """Return the defaults of scenarios, for values that their files omit."""
        return Defaults(
            settings=self.planner,
            limits=self.limits.limits(),
            end_behaviour=EndBehaviour(self.end_behaviour),
            tail=self.post_goal_duration,
            points=self.points,
            controller=self.controller.setup,
        )
