"""The newest state of the chaser and its arm, from the messages of its topics.

The message with the newest stamp counts, in whatever order messages arrive. While that message is
invalid, every request for the state is refused with the reason. So it is while the last message is
stamped ahead of its arrival: the state was not measured then.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass
from functools import partial
from operator import itemgetter

import numpy as np

from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters import NodeParameters
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.inputs.locked_joints import LockedJoints
from ff_planner_ros.ros.inputs.middleware import Middleware
from ff_planner_ros.ros.inputs.topic import HeardMessage, Topic
from ff_planner_ros.ros.messages.from_messages import state_from_message
from ff_planner_ros.ros.messages.from_odometry import (
    ChaserPart,
    JointPart,
    chaser_from_odometry,
    is_pair,
    joints_from_joint_state,
    merged,
)
from ff_planner_ros.ros.messages.joint_names import joint_order, joints_named
from ff_planner_ros.ros.topics import CHASER_STATE, JOINT_STATES, ODOMETRY

# A second of a topic at 1 kHz: no message should travel that much longer than another.
_KEPT = 1000


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The state of the chaser and its arm at a time, and where it was measured."""

    state: SystemState
    stamp_ns: int  # of the chaser's measurement [ns]
    source: str  # topic, or field of the request
    # Of the oldest joint states that go with odometry; zero without odometry [ns]
    joint_states_stamp_ns: int = 0
    # Stamp of the chaser's measurement minus its time of arrival; zero: not known [s]
    clock_offset: float = 0.0


class StateInput:
    """The states received so far; may be used from several threads."""

    def __init__(self, robot: Robot, parameters: NodeParameters, middleware: Middleware) -> None:
        """Subscribe to the topics of `state_source`."""
        self._robot, self._source = robot, parameters.state_source
        self._synchronization = parameters.state_synchronization
        frame, odometry = parameters.inertial_frame, parameters.odometry
        self._joints_in = joints_named(robot.joint_names)
        self.locked, self._measures = LockedJoints(robot), parameters.robot.measures
        if self._source == CHASER_STATE.name:
            states = Topic(
                CHASER_STATE,
                lambda message: state_from_message(message, CHASER_STATE.name, robot, frame),
                middleware,
                kept=_KEPT,
                joints=self._of_chaser_state,
            )
            self._of_chaser: Topic[SystemState] | Topic[ChaserPart] = states
            self._of_joints: Topic[JointPart] | None = None
            self._newest = partial(self._newest_of, states)
        else:
            chasers = Topic(
                ODOMETRY,
                lambda message: chaser_from_odometry(message, frame, odometry),
                middleware,
                kept=_KEPT,
            )
            self._of_chaser = chasers
            self._of_joints = Topic(
                JOINT_STATES,
                lambda message: joints_from_joint_state(message, robot),
                middleware,
                kept=_KEPT,
                joints=self._of_joint_states,
            )
            self._newest = partial(self._newest_pair_of, chasers, self._of_joints)

    def clear(self) -> None:
        """Forget everything; to be called when the clock has jumped back or changed."""
        self._of_chaser.clear()
        if self._of_joints is not None:
            self._of_joints.clear()
        self.locked.clear()

    @property
    def since(self) -> str:
        """Since when no state was received, as the end of a sentence that says so."""
        return self._of_chaser.since

    @property
    def clock_offset(self) -> float | None:
        """Stamp of the chaser's last message minus its time of arrival [s]; None: not known."""
        return self._of_chaser.clock_offset

    def snapshot(
        self, now_ns: int, max_age: float, max_lead: float, locked_tolerance: float = math.inf
    ) -> Snapshot:
        """Return the newest state, if it is at most max_age old and max_lead ahead of now [s].

        Args:
            locked_tolerance: How far a joint that the model has locked may be elsewhere [rad, m],
                and how fast it may move [rad/s, m/s].

        Raises:
            InvalidInput: No state was received, the newest is invalid, too old or too far ahead,
                a topic has several publishers, a joint is missing, no odometry and joint states
                are within `state_synchronization`, or a locked joint is elsewhere.
        """
        found = self._newest(now_ns, max_age, max_lead)
        self.locked.require_locked(locked_tolerance, moving_alone=self._measures)
        return found

    def _newest_of(
        self, states: Topic[SystemState], now_ns: int, max_age: float, max_lead: float
    ) -> Snapshot:
        newest = states.current(now_ns, max_age, max_lead)[-1]
        state, offset = states.read(newest), newest.clock_offset or 0.0
        return Snapshot(state, newest.stamp_ns, self._source, clock_offset=offset)

    def _newest_pair_of(
        self,
        chasers: Topic[ChaserPart],
        joints: Topic[JointPart],
        now_ns: int,
        max_age: float,
        max_lead: float,
    ) -> Snapshot:
        of_chaser = chasers.current(now_ns, max_age, max_lead)
        of_joints = joints.current(now_ns, max_age, max_lead)
        named = {name for heard in of_joints for name in heard.tells_of}
        joint_order("joint_states.name", sorted(named), self._robot.joint_names)
        while True:  # until all that make a state are valid; an invalid message is left out
            chaser, arm, apart = self._nearest(of_chaser, of_joints)
            if chaser is None:
                break
            try:
                part, parts = chasers.read(chaser), [joints.read(heard) for heard in arm]
            except InvalidInput:
                of_chaser = [one for one in of_chaser if not isinstance(one.part, InvalidInput)]
                of_joints = [one for one in of_joints if not isinstance(one.part, InvalidInput)]
                continue
            state = SystemState(*part, *merged(parts))
            oldest_ns, offset = min(heard.stamp_ns for heard in arm), chaser.clock_offset or 0.0
            return Snapshot(state, chaser.stamp_ns, self._source, oldest_ns, offset)
        raise InvalidInput(
            Status.STATE_NOT_SYNCHRONIZED,
            "odometry and joint_states",
            f"{apart:.3f} s apart",
            f"their stamps must be within {self._synchronization:g} s (parameter "
            "state_synchronization); do both computers have the same time?",
        )

    def _nearest(
        self, chasers: list[HeardMessage[ChaserPart]], joints: list[HeardMessage[JointPart]]
    ) -> tuple[HeardMessage[ChaserPart] | None, list[HeardMessage[JointPart]], float]:
        """Return the last odometry that all joints pair with, and their messages, nearest first.

        Of joint states equally near, the last one is taken. If there is no such odometry, it is
        None, and the smallest distance in time of those rejected is told [s].
        """
        groups = defaultdict[frozenset[str], list[HeardMessage[JointPart]]](list)
        for heard in reversed(joints):
            groups[heard.tells_of].append(heard)
        stamps_ns = {names: np.array([one.stamp_ns for one in groups[names]]) for names in groups}
        smallest = np.inf
        for chaser in reversed(chasers):
            nearest = list[tuple[float, HeardMessage[JointPart]]]()
            for names, stamps in stamps_ns.items():
                times = np.abs(stamps - chaser.stamp_ns) / NANOSECONDS
                k = int(np.argmin(times))
                nearest.append((float(times[k]), groups[names][k]))
            nearest.sort(key=itemgetter(0))
            missing, arm, apart = set(self._robot.joint_names), list[HeardMessage[JointPart]](), 0.0
            for time, heard in nearest:
                if missing & heard.tells_of:
                    missing -= heard.tells_of
                    arm.append(heard)
                    apart = time
            if is_pair(apart, self._synchronization):
                return chaser, arm, apart
            smallest = min(smallest, apart)
        return None, [], smallest

    def _of_chaser_state(self, cdr: bytes) -> frozenset[str]:
        self.locked.keep(CHASER_STATE, cdr)
        return frozenset(self._robot.joint_names)

    def _of_joint_states(self, cdr: bytes) -> frozenset[str]:
        self.locked.keep(JOINT_STATES, cdr)
        # Messages of other joints, for example of a gripper, are not errors.
        return frozenset(self._joints_in(cdr))
