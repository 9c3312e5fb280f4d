"""Every parameter of the planner, declared once; the values are in `config/planner.yaml`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from ff_planner_ros.common.forms import a_word
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.common.yaml_file import yaml_document
from ff_planner_ros.parameters.controller import ControllerParameters
from ff_planner_ros.parameters.interfaces import (
    BagParameters,
    OdometryParameters,
    QosParameters,
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
from ff_planner_ros.planning.problem.settings import STRICT_IF_LOW, PlannerSettings, tunable
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
        InvalidInput: A word is unknown, or a plug-in's requirement is refused.
    """

    robot: RobotParameters
    limits: LimitParameters
    bag: BagParameters
    planner: PlannerSettings
    odometry: OdometryParameters
    qos: QosParameters
    controller: ControllerParameters
    tracking: TrackingParameters
    publication: PublicationParameters
    replanning: ReplanningParameters
    rates: RateParameters
    tf: TransformParameters
    library: str = tunable(  # `planner.library`: scenarios know all else of that group
        "Library of plans, a file or the directory of library.npz, whose nearest plan is the first "
        "initial guess; empty: none"
    )
    plug_ins: str = tunable(  # `planner.plugins`, likewise
        "Requirements of installed plug-ins (entry points ff_planner_ros.requirements) that every "
        "plan must keep, as YAML: `keep_out_plane: {point: [0.0, 0.0, 1.0], normal: [0.0, 0.0, "
        "-1.0], distance: 0.1}`; no other plug-in is loaded; empty: none"
    )
    autostart: bool = tunable(
        "Whether the node configures and activates itself at start; if not, a lifecycle manager "
        "does"
    )
    allow_remote_paths: bool = tunable(
        "Whether robot.urdf, robot.srdf and bag.directory may be set over ROS while the node is "
        "unconfigured; if not, those of the process's start count"
    )
    inertial_frame: str = tunable("frame_id that states, obstacles and targets must carry")
    state_source: str = tunable(
        "Source of the state: chaser_state, or odometry (with joint_states)"
    )
    points: int = tunable(
        "Number of points of a trajectory, if the request does not say", MIN_POINTS, MAX_POINTS
    )
    time_budget: float = tunable(
        "Wall-clock time from receiving a request to its answer, if the request does not say; the "
        "plan's start time ends the search, too",
        0.001,
        86_400.0,
        "s",
    )
    attitude_time_budget: float = tunable(
        "Wall-clock time after which the best plan so far is the answer, if the chaser's attitude "
        "has a weight and the request has no budget",
        0.001,
        86_400.0,
        "s",
    )
    planning_lead_time: float = tunable(
        "Time from a request to its plan's start, if the request does not say; it must cover "
        "planning, and what the controller needs to take over",
        minimum=0.0,
        maximum=3600.0,
        unit="s",
    )
    start_horizon: float = tunable(
        "Largest time from now to a start time; a later start is refused",
        0.0,
        86_400.0,
        "s",
        STRICT_IF_LOW,
    )
    following_tolerance: float = tunable(
        "Joints within this of the last plan are taken to follow it until the next one starts; "
        "others keep their measured velocities",
        minimum=0.0,
        maximum=10.0,
        unit="rad",
        strictness=STRICT_IF_LOW,
    )
    when_busy: str = tunable(
        "Treatment of a request that comes during another one: reject answers it with BUSY, "
        "preempt answers the other one with PREEMPTED"
    )
    end_behaviour: str = tunable(
        "Behaviour of the arm after the goal, if the request does not say: none, hold_end_effector "
        "or stop_joints"
    )
    post_goal_duration: float = tunable(
        "Duration of the end behaviour; without effect for none", 0.001, 3600.0, "s"
    )
    state_max_age: float = tunable(
        "Age above which a chaser state is refused", 0.0, 3600.0, "s", STRICT_IF_LOW
    )
    state_future_tolerance: float = tunable(
        "Time ahead of now above which the stamp of a chaser state, or of a target body, is "
        "refused",
        0.0,
        3600.0,
        "s",
        STRICT_IF_LOW,
    )
    locked_joint_tolerance: float = tunable(
        "Allowed difference of a joint that the model has locked, as a state names it, from where "
        "robot.locked_joints has it, and allowed rate of it; beyond, the state is refused",
        minimum=0.0,
        unit="rad, m, rad/s, m/s",
        strictness=STRICT_IF_LOW,
    )
    target_max_age: float = tunable(
        "Age above which a target body is refused; a younger one is carried forward",
        0.0,
        3600.0,
        "s",
        STRICT_IF_LOW,
    )

    obstacles_max_age: float = tunable(
        "Age above which moving obstacles are refused; younger ones are carried forward. Obstacles "
        "at rest may be of any age",
        0.0,
        ANY_AGE,
        "s",
        STRICT_IF_LOW,
    )

    FACTS = ("robot", "time_budget", "points", "end_behaviour")
    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Check the words and the plug-ins' requirements."""
        a_word(STATE_SOURCES).read("state_source", self.state_source)
        a_word((REJECT, PREEMPT)).read("when_busy", self.when_busy)
        _ = self.requirements  # refused here, not with the first request
        a_word(EndBehaviour).read("end_behaviour", self.end_behaviour)

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
