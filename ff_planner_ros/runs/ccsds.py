"""The chaser's motion for tools of flight dynamics: CCSDS OEM (502.0-B) and AEM (504.0-B), KVN.

Both tell it by cubic Hermite polynomials, of position and quaternion. Points between those of the
plan are where the joints' quintics and the conserved momentum have the chaser.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from datetime import UTC, datetime
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.motion.forward import carried_base
from ff_planner_ros.planning.motion.joint_motion import joint_motion
from ff_planner_ros.planning.motion.motion import chaser_rows, from_trajectory
from ff_planner_ros.planning.motion.plan import Trajectory, begins_of
from ff_planner_ros.planning.motion.pose_motion import cubics_between
from ff_planner_ros.planning.motion.sound_samples import require_sound_samples
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import total_momentum
from ff_planner_ros.robot.rotation import cross

# Reference frames of 502.0-B that do not rotate: a plan's frame is inertial.
FRAMES = ("EME2000", "GCRF", "ICRF", "MCI", "TEME", "TOD")
_WORDS = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9 ._()/+-]{0,62}[A-Za-z0-9)])?")
_EPOCH = re.compile(r"(19[7-9]|20\d|21\d)\d-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d{1,9})?Z?", re.ASCII)
# What a cubic may be off half-way, where it is furthest [m, half of an angle in rad].
_OFF = 5e-7, 2.5e-10
_FIRST_EPOCH = 10**9 * NANOSECONDS  # in 2001; a simulation's clock starts at zero
_DOUBLED = 11  # at most 1024 cubics from a point of a plan to the next


@dataclass(frozen=True)
class Labels:
    """What the messages say of object and frame.

    Raises:
        InvalidInput: A value cannot be written, or the frame is none that is inertial.
    """

    object_name: str
    object_id: str
    center_name: str
    ref_frame: str

    def __post_init__(self) -> None:
        """Refuse what a line of the messages cannot hold."""
        for item in fields(self):
            value, option = getattr(self, item.name), f"--{item.name.replace('_', '-')}"
            if not _WORDS.fullmatch(value):
                allowed = "it must be 1 to 64 ASCII letters, digits, spaces and ._()/+-"
                raise InvalidInput(Status.UNSUPPORTED, option, value, allowed)
        if self.ref_frame not in FRAMES:
            allowed = f"it must be one that does not rotate: {', '.join(FRAMES)}"
            raise InvalidInput(Status.UNSUPPORTED, "--ref-frame", self.ref_frame, allowed)


class Segment(NamedTuple):
    """The chaser's motion in a phase, in the inertial frame; one row per point."""

    epochs: Sequence[str]  # UTC
    poses: Array  # x y z [m] and quaternion x y z w, whose sign never jumps; shape (points, 7)
    rates: Array  # of the poses; shape (points, 7) [m/s, 1/s]


def epoch_ns(text: str) -> int:
    """Return a UTC time such as 2026-11-30T12:00:00.5 in nanoseconds since 1970.

    Raises:
        InvalidInput: It is no such time.
    """
    try:
        if not _EPOCH.fullmatch(text):
            raise ValueError
        return int(np.datetime64(text.removesuffix("Z"), "ns").astype(np.int64))
    except ValueError:
        allowed = "it must be a UTC time such as 2026-11-30T12:00:00.5, and no leap second"
        raise InvalidInput(Status.UNSUPPORTED, "--epoch", text, allowed) from None


def segments_of(phases: Sequence[tuple[Robot, Trajectory]], start_ns: int) -> list[Segment]:
    """Return the chaser's motion in each phase of a plan.

    Args:
        start_ns: Of the first point, UTC since 1970 [ns].

    Raises:
        InvalidInput: It has no time in UTC, or samples are malformed or do not fit each other.
    """
    if start_ns < _FIRST_EPOCH:
        allowed = "the plan has no start time in UTC; say when its first point is"
        raise InvalidInput(Status.UNSUPPORTED, "--epoch", "missing", allowed)
    segments = []
    begins = begins_of(trajectory for _, trajectory in phases)
    for (robot, trajectory), begin in zip(phases, begins, strict=True):
        require_sound_samples(robot, trajectory)
        time, poses, rates = _refined(robot, trajectory)
        epochs = np.rint((begin + time) * NANOSECONDS)
        later = (epochs / NANOSECONDS - (begin + time))[:, None]
        told = np.datetime_as_string((start_ns + epochs.astype(np.int64)).astype("datetime64[ns]"))
        segments.append(Segment(told.tolist(), poses + later * rates, rates))
    return segments


def _refined(robot: Robot, trajectory: Trajectory) -> tuple[Array, Array, Array]:
    """Return times, poses and rates of the chaser, so dense that cubics lie between them."""
    for doubled in range(_DOUBLED):
        time, poses, rates = _between(robot, trajectory, 2 << doubled)
        here, told = slice(None, None, 2), slice(1, None, 2)
        off = cubics_between(time[here], poses[here], rates[here], time[told])[0] - poses[told]
        far = [float(np.linalg.norm(part, axis=1).max()) for part in (off[:, :3], off[:, 3:])]
        if far[0] <= _OFF[0] and far[1] <= _OFF[1]:
            return time[here], poses[here], rates[here]
    allowed = "velocities must fit positions: 1024 cubics do not tell the motion"
    raise InvalidInput(Status.UNSUPPORTED, "motion of the chaser", "between two points", allowed)


def _between(robot: Robot, trajectory: Trajectory, steps: int) -> tuple[Array, Array, Array]:
    """Return times, poses and rates of the chaser, so many equal steps from point to point.

    What a point is off the motion from the one before, 1e-8 rad in a plan, comes in smoothly.
    """
    # Where it starts at the origin and at rest: in an orbit the momentum would lose its digits.
    x_0, v_0 = trajectory.chaser_positions[0], trajectory.chaser_linear_velocities[0]
    motion = replace(
        trajectory,
        chaser_positions=trajectory.chaser_positions - x_0 - np.outer(trajectory.time, v_0),
        chaser_linear_velocities=trajectory.chaser_linear_velocities - v_0,
    )
    q, v = from_trajectory(robot, motion)
    joints, data = joint_motion(motion), robot.model.createData()
    s = np.linspace(0.0, 1.0, steps + 1)[:, None]
    blend, slope = s * s * (3.0 - 2.0 * s), 6.0 * s * (1.0 - s)
    parts = []
    for point, (begin, end) in enumerate(pairwise(motion.time.tolist())):
        time = begin + s[:, 0] * (end - begin)
        momentum = total_momentum(robot, data, q[point], v[point])
        place, turn, velocity, spin = chaser_rows(
            robot, *carried_base(robot, q[point], momentum, joints, time)
        ).values()
        aside = motion.chaser_positions[point + 1] - place[-1]
        there = Rotation.from_quat(motion.chaser_quaternions_xyzw[point + 1])
        askew = (there * Rotation.from_quat(turn[-1]).inv()).as_rotvec()
        turn = (Rotation.from_rotvec(blend * askew) * Rotation.from_quat(turn)).as_quat()
        velocity += slope * aside / (end - begin)
        spin += slope * askew / (end - begin)
        parts.append(np.column_stack([time, place + blend * aside, velocity, spin, turn]))
    rows = np.concatenate([*(one[:-1] for one in parts), parts[-1][-1:]])
    time, place, velocity, spin, turn = np.split(rows, [1, 4, 7, 10], axis=1)
    jumps = (turn[1:] * turn[:-1]).sum(axis=1, keepdims=True) < 0.0
    turn[1:] *= np.cumprod(np.where(jumps, -1.0, 1.0), axis=0)
    vector, scalar = turn[:, :3], turn[:, 3:]
    of_scalar = -(spin * vector).sum(axis=1, keepdims=True)
    turning = np.hstack([scalar * spin + cross(spin, vector), of_scalar]) / 2
    poses = np.hstack([place + x_0 + time * v_0, turn])
    return time[:, 0], poses, np.hstack([velocity + v_0, turning])


def oem(segments: Sequence[Segment], labels: Labels) -> str:
    """Return the position [km] and velocity [km/s] of the chaser as an Orbit Ephemeris Message."""
    lines = _head("OEM", "2.0")
    for one in segments:
        comment = "centre of mass of the chaser, without its arm"
        lines += [*_meta(one, labels, comment, f"REF_FRAME = {labels.ref_frame}")]
        lines += ["INTERPOLATION = HERMITE", "INTERPOLATION_DEGREE = 3", "META_STOP", ""]
        km = np.hstack([one.poses[:, :3], one.rates[:, :3]]) / 1e3
        lines += [*_rows(one.epochs, km, "{:.12f}"), ""]
    return "\n".join(lines)


def aem(segments: Sequence[Segment], labels: Labels) -> str:
    """Return the attitude of the chaser as an Attitude Ephemeris Message.

    Its quaternion Q1 Q2 Q3 QC takes components in the inertial frame A to those in the chaser's B.
    """
    lines = _head("AEM", "1.0")
    for one in segments:
        comment = "SC_BODY_1 are the axes of the chaser, those of the base link"
        frames = (
            f"REF_FRAME_A = {labels.ref_frame}",
            "REF_FRAME_B = SC_BODY_1",
            "ATTITUDE_DIR = A2B",
        )
        lines += [*_meta(one, labels, comment, *frames)]
        lines += ["ATTITUDE_TYPE = QUATERNION/DERIVATIVE", "QUATERNION_TYPE = LAST"]
        lines += ["INTERPOLATION_METHOD = HERMITE", "INTERPOLATION_DEGREE = 3", "META_STOP", ""]
        numbers = np.hstack([one.poses[:, 3:], one.rates[:, 3:]])
        lines += ["DATA_START", *_rows(one.epochs, numbers, "{:.15f}"), "DATA_STOP", ""]
    return "\n".join(lines)


def _head(message: str, version: str) -> list[str]:
    created = f"CREATION_DATE = {datetime.now(UTC):%Y-%m-%dT%H:%M:%S}"
    return [f"CCSDS_{message}_VERS = {version}", created, "ORIGINATOR = FF_PLANNER", ""]


def _meta(segment: Segment, labels: Labels, comment: str, *frames: str) -> Iterator[str]:
    yield from ("META_START", f"COMMENT {comment}")
    for name in ("object_name", "object_id", "center_name"):
        yield f"{name.upper()} = {getattr(labels, name)}"
    yield from (*frames, "TIME_SYSTEM = UTC")
    yield f"START_TIME = {segment.epochs[0]}"
    yield f"STOP_TIME = {segment.epochs[-1]}"


def _rows(epochs: Sequence[str], numbers: Array, form: str) -> Iterator[str]:
    for epoch, row in zip(epochs, numbers.tolist(), strict=True):
        yield " ".join([epoch, *map(form.format, row)])
