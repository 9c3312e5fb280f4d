"""The planning problem: the request to the planner, checked as a whole."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import SHORTEST_DIRECTION, finite_vector
from ff_planner_ros.common.declared import check_declared, declare, declare_inline
from ff_planner_ros.common.declared_parts import changes, part
from ff_planner_ros.common.forms import TEXT, a_number, a_whole_number, a_word, each, or_part
from ff_planner_ros.common.plain_values import an_object
from ff_planner_ros.common.shown import in_a_line, quoted
from ff_planner_ros.errors import InvalidInput, Status, fields_named
from ff_planner_ros.planning.problem.approach import Approach
from ff_planner_ros.planning.problem.camera import Camera
from ff_planner_ros.planning.problem.goal_words import Orientation, Parametrisation
from ff_planner_ros.planning.problem.limits import ANY_ATTITUDE, ChaserGoal, Limits
from ff_planner_ros.planning.problem.objective import SHORTEST, DurationRange, Objective
from ff_planner_ros.planning.problem.obstacles import (
    OBSTACLE,
    Obstacle,
    RigidMotion,
    attached,
    carried,
    require_foretold,
    with_attached,
)
from ff_planner_ros.planning.problem.path.followed import PathToFollow, followed_target
from ff_planner_ros.planning.problem.posture import GOAL, Posture, target_of_posture
from ff_planner_ros.planning.problem.target import (
    Target,
    require_enough_joints,
    target_on_the_table,
)
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.planning.problem.user_requirements import REQUIRED
from ff_planner_ros.robot.collision.solids import in_order
from ff_planner_ros.robot.configuration import about
from ff_planner_ros.robot.model import Base, Robot
from ff_planner_ros.robot.plane import MAX_TILT, on_the_table
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.robot.wheels import held

if TYPE_CHECKING:
    from ff_planner_ros.planning.requirements.requirement import Requirement

__all__ = [
    "MAX_POINTS",
    "MIN_POINTS",
    "Approach",
    "ChaserGoal",
    "DurationRange",
    "Limits",
    "Objective",
    "Obstacle",
    "Orientation",
    "Parametrisation",
    "PathToFollow",
    "PlanningProblem",
    "Posture",
    "RigidMotion",
    "Target",
    "TargetBody",
    "attached",
    "carried",
    "lasting",
    "with_attached",
    "with_capture_target",
]

# Five points hold a plan's start, end and middle; above ten thousand the answer no longer
# fits a service response that a mission executive would want to read.
MIN_POINTS, MAX_POINTS = 5, 10_000
# Default; the parameter `points` has the same.
USUAL_POINTS = 50

# Default contact distance [m]: what a tool closes on is within its reach.
CONTACT_DISTANCE = 0.1


# Fields that errors name instead of a target's, if it is the grasp of a body.
_OF_BODY = {
    "target.position": "target_body.grasp.position",
    "target.quaternion_xyzw": "target_body.grasp.quaternion_xyzw",
    "target.linear_velocity": "target_body.linear_velocity",
    "target.angular_velocity": "target_body.angular_velocity",
}


@dataclass(frozen=True, eq=False)
class PlanningProblem:
    """The request to the planner: a motion from a start state to a target.

    Raises:
        InvalidInput: A duration or contact distance that is not positive, a duration out of its
            range, a number of points out of range, a contact or a camera's link that is none of
            the robot's, an approach in a direction that the target leaves open, a state or limits
            whose number of joints is not the robot's, a state that leaves the plane of a planar
            base, or one that turns although wheels hold its attitude.
    """

    FIRST: ClassVar[Sequence[str]] = ("target", "target_body")

    robot: Robot  # its continuous joints may do two turns either way of the start
    start: SystemState  # state at the first point of the plan
    # With a target body, its grasp: see `with_capture_target`
    target: Target = declare(
        GOAL,
        "goal of the end effector, or of the joints, at the last point of the plan",
        optional=True,
        message="goal",
    )
    duration: float = declare(
        or_part(a_number(above=0.0, at_least=SHORTEST), part(DurationRange)),
        "time from the first point to the goal; from a range, the planner chooses it",
        unit="s",
        message="duration",
    )
    points: int = declare(
        a_whole_number(MIN_POINTS, MAX_POINTS),
        f"number of points of the plan; default {USUAL_POINTS}",
        optional=True,
        message="search.points",
    )
    obstacles: tuple[Obstacle, ...] = declare(each(OBSTACLE), "spheres and convex bodies to avoid")
    objective: Objective = declare(
        part(Objective),
        "what is minimised",
        message="objective",
    )
    limits: Limits = declare(
        changes(Limits),
        "limits beside the joints' position limits",
        default=Limits(),
        message="limits",
    )
    parametrisation: Parametrisation = declare(
        a_word(Parametrisation),
        "trajectory parameterisation, the family of paths that is searched",
        default=Parametrisation.AUTO,
        message="search.parametrisation",
    )
    # At the goal from when on the end effector stays within the contact distance, and in the tail
    allowed_collisions: tuple[str, ...] = declare(
        each(TEXT),
        "pairs that may touch at the goal and, if they touch there, at the start, link/obstacle or "
        "link/link",
        key="allowed_collisions.pairs",
        brief=True,
        default=(),
        message="goal.allowed_collisions[0].pairs",
    )
    contact_distance: float = declare(
        a_number(above=0.0),
        "distance of the end effector from its goal, or from where it began, within which they may "
        "touch",
        key="allowed_collisions.distance",
        unit="m",
        brief=True,
        default=CONTACT_DISTANCE,
        message="goal.allowed_collisions[0].distance",
    )
    # Its grasp is the target, and some of the obstacles are fixed to it
    target_body: TargetBody | None = declare(
        part(TargetBody),
        "instead of target: a freely moving body, at the plan's first point",
        default=None,
    )
    chaser_goal: ChaserGoal = declare_inline(ChaserGoal, default=ANY_ATTITUDE)
    # Goal of the joints: the target is then a placeholder. None: the target is the goal
    posture: Posture | None = None
    # That the end effector follows: the target is where it ends. None: any way to the target
    path: PathToFollow | None = None
    # Range that the planner chooses the duration from; None: the duration is given
    duration_range: DurationRange | None = None
    approach: Approach | None = declare(
        part(Approach),
        "straight corridor of the last stretch; default: none",
        default=None,
        message="goal.approach[0]",
    )
    camera: Camera | None = declare(
        part(Camera),
        "fixed to a link, that keeps the goal in view; default: no view is kept",
        default=None,
        message="camera[0]",
    )
    requirements: tuple[Requirement, ...] = declare(
        REQUIRED,
        "requirements of plug-ins, by the names of their entry points, "
        "`ff_planner_ros.requirements`",
        brief=True,
        default=(),
    )

    FACTS = ("robot", "duration", "points", "obstacles", "posture", "target")
    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Check what the parts cannot check by themselves."""
        kinds = {"robot": Robot, "start": SystemState, "posture": Posture, "path": PathToFollow}
        check_declared(self, "", **kinds, target=Target, duration_range=DurationRange)
        an_object("chaser_goal", self.chaser_goal, ChaserGoal)
        object.__setattr__(self, "obstacles", in_order(self.obstacles))
        window = self.duration_range
        if window is not None and not window.minimum <= self.duration <= window.maximum:
            allowed = f"it must be from {window.minimum:g} s to {window.maximum:g} s"
            raise InvalidInput(Status.OUT_OF_RANGE, "duration", self.duration, allowed)
        finite_vector("joints.position", self.start.joint_positions, self.robot.joints)
        object.__setattr__(self, "robot", about(self.robot, self.start.joint_positions))
        object.__setattr__(self, "limits", self.limits.of_joints(self.robot.joints))
        if self.robot.wheels is not None:
            object.__setattr__(self, "start", held(self.robot.wheels, self.start))
        if self.robot.base is Base.PLANAR:
            object.__setattr__(self, "start", on_the_table(self.start))
        object.__setattr__(self, "target", self._goal())
        require_foretold(self.obstacles, self.durations.maximum)
        # In one order, so that equal problems are equal.
        object.__setattr__(self, "allowed_collisions", tuple(sorted(set(self.allowed_collisions))))
        if self.allowed_collisions:
            self._require_known_contacts()
        if self.approach is not None:
            self._require_approachable(self.approach)
        if self.camera is not None:
            self._require_known_link(self.camera.link)

    def _goal(self) -> Target:
        """Return the target, checked: of a posture the placeholder, of a path where it ends."""
        if self.posture is not None:
            return target_of_posture(self, self.posture)
        target = self.target if self.path is None else followed_target(self, self.path)
        if self.robot.base is Base.PLANAR:
            with fields_named({} if self.target_body is None else _OF_BODY):
                target = target_on_the_table(self.robot, self.start, target)
        require_enough_joints(self.robot, target)
        return target

    @property
    def durations(self) -> DurationRange:
        """Range of durations to choose from, of length zero if the duration is given."""
        return self.duration_range or DurationRange(self.duration, self.duration)

    def _require_approachable(self, approach: Approach) -> None:
        """Refuse a direction that the target leaves open, or one out of the plane."""
        target, direction, allowed = self.target, approach.direction, ""
        to_inertial = pin.Quaternion(target.quaternion_xyzw).toRotationMatrix()
        if target.orientation is Orientation.FREE:
            allowed = "with orientation free the grasp has no axes to tell a direction in"
        elif target.free_axis_in_ee is not None:
            aside = np.cross(direction, target.free_axis_in_ee)
            if float(np.linalg.norm(aside)) > SHORTEST_DIRECTION:
                allowed = "with orientation about_axis it must be along free_axis"
        elif self.robot.base is Base.PLANAR and abs(float(to_inertial[2] @ direction)) > MAX_TILT:
            allowed = "with robot.base planar it must lie in the plane of the table"
        if allowed:
            raise InvalidInput(
                Status.UNSUPPORTED, "approach.direction", direction.tolist(), allowed
            )

    def _require_known_link(self, link: str) -> None:
        """Refuse a camera on an unknown link."""
        links = [one.name for one in self.robot.model.frames if one.type is pin.FrameType.BODY]
        if link not in links:
            allowed = f"it must be a link of the robot: {', '.join(links)}"
            raise InvalidInput(Status.OUT_OF_RANGE, "camera.link", quoted(link), allowed)

    def _require_known_contacts(self) -> None:
        """Refuse an allowed contact of an unknown link, pair or obstacle."""
        links = [body.link for body in self.robot.bodies]
        pairs = [(links[a], links[b]) for a, b in self.robot.pairs]
        obstacles = [one.id for one in self.obstacles]
        known = {f"{a}/{b}" for a, b in (*pairs, *((b, a) for a, b in pairs))}
        known |= {f"{link}/{obstacle}" for link in links for obstacle in obstacles}
        for name in self.allowed_collisions:
            if name not in known:
                allowed = (
                    "it must be link/obstacle or link/link, of links with shapes: "
                    f"{', '.join(dict.fromkeys(links))}; and obstacles: {', '.join(obstacles)}"
                    if links
                    else "with robot.geometry lines nothing but the arm's lines is kept clear"
                )
                raise InvalidInput(
                    Status.OUT_OF_RANGE, "allowed_collisions.pairs", quoted(name), allowed
                )


def with_capture_target(body: TargetBody, problem: PlanningProblem) -> PlanningProblem:
    """Return a problem whose goal is the grasp of a body, with its attached obstacles.

    The goal of the problem, and obstacles that are fixed to another body, are left out.

    Raises:
        InvalidInput: An attached obstacle has the id of another one, or the body rotates too far
            to be predicted.
    """
    an_object("body", body, TargetBody)
    given = an_object("problem", problem, PlanningProblem).obstacles
    others = tuple(one for one in given if one.body is None)
    return replace(
        problem,
        target=body.target(problem.duration),
        obstacles=with_attached(others, body),
        target_body=body,
    )


def lasting(problem: PlanningProblem, duration: float | None) -> PlanningProblem:
    """Return a problem with one duration in place of its range; without a range, unchanged.

    Args:
        duration: The chosen duration [s]. None: that of the problem.
    """
    window, body = problem.duration_range, problem.target_body
    if window is None:
        return problem
    chosen = problem.duration if duration is None else duration
    if body is not None:
        target = body.target(chosen)
    else:
        target, way = problem.target, (chosen - problem.duration) * window.target_velocity
        if way.any():
            target = replace(target, position=target.position + way)
    return replace(problem, duration=chosen, target=target, duration_range=None)
