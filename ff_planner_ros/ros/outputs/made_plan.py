"""A plan from its check to the end of its execution, as all that is published of it needs it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from ff_planner_msgs.msg import Plan as PlanMessage
from visualization_msgs.msg import Marker

from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.planning.task.captured import CapturedBody, captured_in
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.messages.to_messages import plan_message
from ff_planner_ros.ros.outputs.markers import plan_markers


@dataclass(frozen=True, eq=False)
class MadePlan:
    """A plan that passed every check, with what is needed to publish it."""

    plan_id: str
    plan: Plan
    start_ns: int  # time of its first point [ns]
    end_behaviour: str
    robot: Robot  # with its payload
    scene: Scene  # at the plan's first point
    inertial_frame: str
    previous_plan_id: str = ""  # plan that the joints follow until the start; empty: none
    made_ns: int = 0  # when the plan was ready [ns]

    @property
    def captured(self) -> CapturedBody | None:
        """The body that it captures; None: none."""
        return captured_in(self.scene)

    @cached_property
    def markers(self) -> Sequence[Marker]:
        """Markers of the plan and its scene; the first one deletes all earlier markers."""
        drawn = plan_markers(self.robot, self.plan, self.scene, self.inertial_frame)
        return tuple(drawn.markers)

    def written(self) -> PlanMessage:
        """Return the plan as a message; thousands of points take a second."""
        return plan_message(self.plan, self.start_ns, self.inertial_frame, self.captured)

    def may_go_out(self, now_ns: int, most: float) -> bool:
        """Return whether the start is not over and the age is at most `most` seconds."""
        return self.start_ns >= now_ns and self.age(now_ns) <= most

    def age(self, now_ns: int) -> float:
        """Return how long ago the plan was ready [s]."""
        return (now_ns - self.made_ns) / NANOSECONDS
