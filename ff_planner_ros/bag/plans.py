"""The planner's answers in a bag as arrays, read without ROS and without ff_planner_msgs."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ff_planner_ros.bag.answers import Cell, answer_row, asked_in, solver_in
from ff_planner_ros.bag.exchanges import Exchange, exchanges
from ff_planner_ros.bag.reader import Bag, open_bag
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.declared_messages import value_at
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.common.text_file import AnyPath, path_of
from ff_planner_ros.common.times import nanoseconds
from ff_planner_ros.errors import BagError, InvalidInput, Status
from ff_planner_ros.messages.trajectories import (
    begin_of,
    poses_in,
    trajectory_in,
    trajectory_of,
    twists_in,
)
from ff_planner_ros.messages.wheels import wheels_of
from ff_planner_ros.planning.motion.plan import (
    AXES,
    COLUMNS,
    JOINT_COLUMNS,
    QUATERNION,
    BodyMotion,
    Trajectory,
    WheelMotion,
    columns_of,
    in_end_effector,
    with_end_effector,
)
from ff_planner_ros.robot.urdf.urdf_faults import Faults
from ff_planner_ros.robot.urdf.urdf_xml import read_elements

NO_ANSWER = "no answer"
_TARGET_BODY_COLUMNS: Mapping[str, tuple[str, tuple[str, ...], str]] = {
    "positions": ("target_body_", AXES, "_m"),
    "quaternions_xyzw": ("target_body_", QUATERNION, ""),
    "linear_velocities": ("target_body_velocity_", AXES, "_m_per_s"),
    "angular_velocities": ("target_body_angular_velocity_", AXES, "_rad_per_s"),
}


@dataclass(frozen=True, eq=False)
class RecordedPlan:
    """A request with its answer, and the plan in it if there is one."""

    plan_id: str  # as the planner named it
    topic: str  # of the planner's exchanges
    answered_ns: int  # when the answer was recorded, since the epoch
    status: str  # name of the status, its number if this version does not know it, or NO_ANSWER
    message: str  # of the status
    start_ns: int  # of the plan, since the epoch; zero without a plan
    # In the order of the trajectory's columns; of a refusal: as in the plan before, or else after
    joint_names: tuple[str, ...]
    trajectory: Trajectory | None  # in the inertial frame, NaN where the bag lacks it
    # Metrics of the plan, or of the best attempt if any; names as in `PlanMetrics.msg`
    metrics: Mapping[str, float | str | tuple[float, ...]]
    # Fields of the request, and figures of the solver, by column of the table of answers
    asked: Mapping[str, Cell] = field(default_factory=dict)  # empty: the bag lacks the request
    asked_ns: int = 0  # when the node received the request, by its clock; zero: not known
    solver: Mapping[str, Cell] = field(default_factory=dict)
    # From the start to the goal, given or chosen [s]; None: no plan
    duration: float | None = None
    # Motion of the captured body, in the inertial frame, a row per point: `positions`,
    # `quaternions_xyzw`, `linear_velocities`, `angular_velocities`; empty: no capture
    target_body: Mapping[str, Array] = field(default_factory=dict)

    wheels: WheelMotion | None = None  # None: the chaser has no wheels, or the bag lacks them
    sliding: frozenset[str] = frozenset()  # prismatic joints, by the URDF in the bag
    # Each phase of a sequence, with times from its own first point on; empty: a single phase
    phases: tuple[Trajectory, ...] = ()
    interface: str = ""  # that the request came by: service, action, replanning
    requester: str = ""  # who asked

    FACTS = ("plan_id", "status", "message", "trajectory")
    __repr__ = in_a_line

    def row(self) -> dict[str, Cell]:
        """Return the answer as a row of a table, with units in the names of its columns.

        The columns are the same for every answer of every bag; a missing value is None.
        """
        return answer_row(self)

    def columns(self) -> dict[str, Array]:
        """Return the plan as columns of equal length with units in their names; pandas takes them.

        Without a plan they are empty. A plan that captures a body has columns of the body, too, and
        the plan of a chaser with wheels has columns of the wheels.
        """
        motion = self.trajectory
        if motion is None:
            motion = _motion_of_no_points(len(self.joint_names))
        columns = columns_of(motion, [(name, name in self.sliding) for name in self.joint_names])
        columns |= {} if self.wheels is None else _wheel_columns(self.wheels)
        for part, rows in self.target_body.items():
            before, names, unit = _TARGET_BODY_COLUMNS[part]
            for number, name in enumerate(names):
                columns[f"{before}{name}{unit}"] = rows[:, number]
        return columns


def _wheel_columns(wheels: WheelMotion) -> dict[str, Array]:
    """Return the wheels' momenta and torques as columns."""
    return {
        f"wheel_{wheel}_{quantity}": column
        for quantity, rows in (("momentum_Nms", wheels.momenta), ("torque_Nm", wheels.torques))
        for wheel, column in enumerate(rows.T, start=1)
    }


def read_plans(bag: AnyPath) -> list[RecordedPlan]:
    """Read every answer of the planner in a bag, in the order of the answers.

    The bag is a directory or one MCAP file. Faults of the bag are issued as warnings.

    Raises:
        BagError: Nothing of the bag can be read.
    """
    with open_bag(path_of("bag", bag)) as opened:
        plans = recorded_plans(opened)
        for note in opened.notes:
            warnings.warn(note, stacklevel=2)
    return plans


def recorded_plans(bag: Bag) -> list[RecordedPlan]:
    """Return every answer of the planner, in the order of the answers.

    Raises:
        BagError: The disk fails.
    """
    return [one for one in recorded_requests(bag) if one.status != NO_ANSWER]


def recorded_requests(bag: Bag) -> list[RecordedPlan]:
    """Return every request with its answer, in their order; those without an answer come last.

    Raises:
        BagError: The disk fails.
    """
    found = list[tuple[str, RecordedPlan]]()
    sliding: frozenset[str] | None = None
    for one in exchanges(bag):
        sliding = _sliding(one.urdfs) if sliding is None else sliding
        try:
            found.append((one.planner, replace(recorded_plan(one), sliding=sliding)))
        except BagError as error:
            bag.note(str(error))
    return _with_joint_names(found)


def _with_joint_names(found: Sequence[tuple[str, RecordedPlan]]) -> list[RecordedPlan]:
    """Return the answers of planners, each refusal with the joint names of its planner's plans."""
    names = {planner: one.joint_names for planner, one in reversed(found) if one.joint_names}
    plans = []
    for planner, one in found:
        names[planner] = one.joint_names or names.get(planner, ())
        plans.append(replace(one, joint_names=names[planner]))
    return plans


def _sliding(urdfs: Iterable[str]) -> frozenset[str]:
    """Return the prismatic joints of URDFs; those that are invalid have none."""
    found = set[str]()
    for urdf in urdfs:
        with suppress(InvalidInput):
            robot = read_elements(urdf, Faults())
            found |= {one.get("name", "") for one in robot.findall("joint[@type='prismatic']")}
    return frozenset(found)


def recorded_plan(exchange: Exchange) -> RecordedPlan:
    """Return a request and its answer as plain arrays.

    Raises:
        BagError: The answer cannot be understood, or its arrays do not fit each other.
    """
    try:
        return _recorded_plan(exchange)
    except (AttributeError, TypeError, ValueError, LookupError, OverflowError) as error:
        name = exchange.plan_id or "an answer"
        raise BagError(f"{name} on {exchange.topic} cannot be understood: {error}") from None


def _motion_of_no_points(joints: int) -> Trajectory:
    widths = dict.fromkeys(JOINT_COLUMNS, joints)
    widths |= {part: len(names) for part, (_, names, _) in COLUMNS.items()}
    return Trajectory(np.empty(0), **{part: np.empty((0, w)) for part, w in widths.items()})


def _recorded_plan(exchange: Exchange) -> RecordedPlan:
    request, answer = exchange.request, exchange.answer
    asked = RecordedPlan(
        plan_id=exchange.plan_id,
        topic=exchange.topic,
        answered_ns=exchange.logged_ns,
        status=NO_ANSWER,
        message="",
        start_ns=0,
        joint_names=(),
        trajectory=None,
        metrics={},
        asked={} if request is None else asked_in(request),
        asked_ns=exchange.asked_ns,
        interface=exchange.interface,
        requester=exchange.requester,
    )
    if answer is None:
        return asked
    code, metrics = int(answer.status.code), value_at(answer, "metrics[0]", None)
    answered = replace(
        asked,
        status=status_name(code),
        message=str(answer.status.message),
        metrics={} if metrics is None else _metrics(metrics),
        solver=solver_in(answer),
    )
    if code != Status.SOLVED:
        return answered
    plans, motion = answer.plans, answer.plans[0].joint_trajectory
    return replace(
        answered,
        start_ns=nanoseconds(motion.header.stamp),
        joint_names=tuple(map(str, motion.joint_names)),
        trajectory=trajectory_of(plans),
        duration=_duration(plans),
        target_body=_target_body(plans),
        wheels=wheels_of(plans),
        phases=tuple(map(trajectory_in, plans)) if len(plans) > 1 else (),
    )


def _duration(plans: Sequence[Any]) -> float | None:
    """Return when the last goal is reached, from the first point on [s]; None: not recorded."""
    last = len(plans) - 1
    told = value_at(plans[last], "duration", 0.0)
    return begin_of(plans, last) + told if told else None


def _target_body(plans: Sequence[Any]) -> dict[str, Array]:
    """Return the predicted motion of the captured body; empty: no capture.

    In a sequence it is NaN before the phase of the capture; in the phases after, the end effector
    holds the body as it is at the end of that phase.
    """
    found: BodyMotion | None = None
    before, place = 0, np.empty(7)
    for plan in plans:
        motion = trajectory_in(plan)
        if found is not None:
            found = found.followed_by(with_end_effector(motion, place, slice(1, None)))
        elif value_at(plan, "target_path.poses", ()):
            poses = poses_in(plan.target_path, len(motion.time))
            twists = twists_in(plan.target_twists, len(motion.time))
            found = BodyMotion(*np.hsplit(poses, [3]), *np.hsplit(twists, 2))
            place = in_end_effector(motion, poses[-1])
            missing = [np.full((before, rows.shape[1]), np.nan) for rows in found]
            found = BodyMotion(*missing).followed_by(found)
        before += len(motion.time) - 1
    return {} if found is None else dict(zip(_TARGET_BODY_COLUMNS, found, strict=True))


def _metrics(metrics: Any) -> dict[str, float | str | tuple[float, ...]]:
    return {
        name: value
        if isinstance(value, str)
        else (tuple(value.tolist()) if isinstance(value, np.ndarray) else float(value))
        for name, value in vars(metrics).items()
        if not name.startswith("_")
    }


def status_name(code: int) -> str:
    """Return the name of a status, or the code itself if this version does not know it."""
    return Status(code).name if code in Status.__members__.values() else str(code)
