"""Visualisation of plans: markers, and the joint motion, played in a loop.

A plan that waits for release is played instead of the published one, and drawn beside it, until it
is released, rejected or too late: an operator has to look at it.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Sequence
from copy import copy
from itertools import cycle
from typing import NamedTuple

import numpy as np
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.lifecycle import LifecycleNode
from sensor_msgs.msg import JointState
from visualization_msgs.msg import Marker, MarkerArray

from ff_planner_ros.parameters import NodeParameters
from ff_planner_ros.planning.motion.joint_motion import joint_motion
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.ros.outputs.made_plan import MadePlan
from ff_planner_ros.ros.outputs.markers import waiting_markers
from ff_planner_ros.ros.outputs.transforms import Transforms
from ff_planner_ros.ros.qos import create_lifecycle_publisher
from ff_planner_ros.ros.topics import MARKERS, PLANNED_JOINT_STATES


class Previewed(NamedTuple):
    """Joint state at one time of a preview."""

    time: float  # since the plan's first point [s]
    joints: JointState


class Preview:
    """Shows the plan that was published last, and the plan that waits for release."""

    def __init__(
        self, node: LifecycleNode, transforms: Transforms, parameters: NodeParameters
    ) -> None:
        """Create the publishers, which are silent until the node is active."""
        self._node, self._transforms = node, transforms
        self._clock, self._rate = node.get_clock(), parameters.rates.preview
        self._lock = threading.Lock()
        self._released: MadePlan | None = None
        self._waiting: MadePlan | None = None
        self._played: MadePlan | None = None
        self._states: Iterator[Previewed] = iter(())
        self._repeated_since_ns: int | None = None  # None while it is played for the first time
        self._viewers = 1  # when they were last counted
        self._markers = create_lifecycle_publisher(node, MARKERS)
        self._joint_states = create_lifecycle_publisher(node, PLANNED_JOINT_STATES)
        self.publishers = self._markers, self._joint_states
        group = MutuallyExclusiveCallbackGroup()
        self._timer = node.create_timer(1.0 / self._rate, self._play, group)
        self._timer.cancel()  # until there is something to play

    def release(self, released: MadePlan) -> None:
        """Show a published plan from the next `draw` on; it waits no longer."""
        self._released = released
        if self._waiting is released:
            self._waiting = None

    def let_wait(self, waiting: MadePlan | None) -> bool:
        """Show a plan that waits for release from the next `draw` on; None: no plan waits.

        Returns:
            Whether it is another plan than before.
        """
        changes, self._waiting = waiting is not self._waiting, waiting
        return changes

    def draw(self) -> None:
        """Publish the markers, and play the waiting plan, or else the published one."""
        with self._lock:
            released, waiting = self._released, self._waiting
            markers = [Marker(action=Marker.DELETEALL)] if released is None else released.markers
            if waiting is not None:
                markers = [*markers, *waiting_markers(waiting.plan_id, waiting.markers[1:])]
            self._markers.publish(MarkerArray(markers=[copy(one) for one in markers]))
            shown = waiting or released
            if shown is not self._played:
                self._played = shown
                states = [] if shown is None else preview_joint_states(shown.plan, self._rate)
                self._states, self._repeated_since_ns = self._again_and_again(states), None
                self._timer.reset()

    def look_for_viewers(self, recorders: int) -> None:
        """Play on in a loop if there are more subscribers than recorders.

        Viewers that draw frames hear markers and `/tf` alone; `/tf` has other listeners, too.
        """
        self._viewers = max(one.get_subscription_count() for one in self.publishers) - recorders
        if self._viewers > 0 and self._timer.is_canceled() and self._repeated_since_ns is not None:
            self._timer.reset()

    def is_repeated(self, received_ns: int) -> bool:
        """Return whether what was received at a time of the host [ns] repeats the first pass."""
        since_ns = self._repeated_since_ns
        return since_ns is not None and received_ns >= since_ns

    def close(self) -> None:
        """Remove the timer from the node."""
        self._node.destroy_timer(self._timer)

    def _again_and_again(self, states: Sequence[Previewed]) -> Iterator[Previewed]:
        yield from states
        self._repeated_since_ns = time.time_ns()
        yield from cycle(states)

    def _play(self) -> None:
        # The first time it is played for the bag, too, which repeats nothing.
        is_seen, played = self._repeated_since_ns is None or self._viewers > 0, self._played
        shown = next(self._states, None) if is_seen else None
        if shown is None or played is None:
            self._timer.cancel()
            return
        now = self._clock.now()
        shown.joints.header.stamp = now.to_msg()
        self._transforms.preview(
            played.plan.trajectory,
            shown.time,
            shown.joints.position,
            now.nanoseconds,
            played.captured,
        )
        self._joint_states.publish(shown.joints)


def preview_joint_states(plan: Plan, rate: float) -> list[Previewed]:
    """Return one pass through a plan at a rate [Hz], first and last point included.

    The states have no stamp: the publisher sets it to now.
    """
    duration = float(plan.trajectory.time[-1])
    # The last step is the shorter one, where the duration is no multiple of the period.
    times = np.append(np.arange(0.0, duration, 1.0 / rate), duration)
    positions, velocities, _ = joint_motion(plan.trajectory).at(times)
    return [
        Previewed(
            time, JointState(name=list(plan.joint_names), position=position, velocity=velocity)
        )
        for time, position, velocity in zip(
            times.tolist(), positions.tolist(), velocities.tolist(), strict=True
        )
    ]
