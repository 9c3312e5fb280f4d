"""Judgement of an answer to a scenario: is it well-formed, at the goal, within limits, and clear?

An answer has `time`, `joint_positions` and `joint_velocities`, a row per point, perhaps
`joint_accelerations`, as `ff-planner plan --json` writes them; everything else in it is ignored.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BPoly
from scipy.spatial.transform import Rotation

from ff_planner_benchmark.scorer.chain import Array, Chain
from ff_planner_benchmark.scorer.clearance import body_motion, clearance
from ff_planner_benchmark.scorer.files import json_of, text_of, yaml_of
from ff_planner_benchmark.scorer.flight import Flight, at_moments, flown, joint_motion, torques

# Errors at the goal: position [m], orientation [rad], velocity [m/s], angular velocity [rad/s].
MISS, TURN, SPEED, SPIN = 1e-3, 2e-3, 1e-3, 2e-3
# Error of the first point against the start [rad, rad/s].
START = 1e-4
# Excess over limits of joint positions [rad], and relative excess of velocities and torques.
POSITION, RATE, TORQUE = 1e-4, 1e-3, 0.02
# Deviation of the joints from the smooth motion through the moments: positions, in sum [rad], and
# velocities, each [rad/s].
UNSEEN, UNSEEN_RATE = 1e-4, 0.02
# Points of an answer: to judge ten times as many takes as many seconds as a method has.
MOST_POINTS = 10_000
# Samples of an answer's motion between two of its points.
_LOOKS = 5
_LONGEST = 1e4  # [s] that a motion lasts; those of the data set last 15 s at most
# Characters of a method's message.
_LONGEST_REASON = 200
# Bound of every number in an answer.
_LARGEST = 1e6
# Penetration that is allowed for rounding [m].
CLEARANCE = 1e-6


@dataclass(frozen=True)
class Score:
    """The judgement of an answer. Lengths in m, angles in rad; None: there is no motion."""

    solved: bool
    faults: tuple[str, ...]  # why it is not solved; empty: it is
    clearance: float | None = None  # lower bound over all times; None, too: there is no obstacle
    sampled_clearance: float | None = None  # at the samples; None, too: there is no obstacle
    miss: float | None = None  # position error of the end effector at the end, as executed
    turn: float | None = None  # orientation error; None, too: the orientation is free
    joint_path: float | None = None
    attitude: float | None = None  # largest rotation angle of the chaser since its start


def load(scenario: Path) -> tuple[dict[str, Any], Chain, list[list[str]]]:
    """Return a scenario, its robot, and the pairs of links that must not touch.

    Raises:
        ValueError: A file of the scenario is no file of the data set.
        OSError: A file cannot be read.
        LookupError: A file lacks a value.
        TypeError: A value is of another type.
        AttributeError: Likewise.
    """
    content = yaml_of(text_of(scenario))
    urdf = scenario.parent / content["robot"]["urdf"]
    chain = Chain(text_of(urdf), content["robot"]["base_link"], content["robot"]["tip_link"])
    beside = urdf.with_suffix(".json")
    pairs = json_of(text_of(beside))["must_not_touch"] if beside.exists() else []
    if not 0.0 < float(content["duration"]) < _LONGEST:
        raise ValueError(f"its duration is {content['duration']} s")
    if missing := {"chaser", "limits"} - content.keys():
        raise ValueError(f"it has no {min(missing)}")
    body = content.get("target_body", {"obstacles": ()})
    if any("shape" in one for one in (*content["obstacles"], *body["obstacles"])):
        raise ValueError("its obstacles are not all spheres, which alone are judged")
    for name in ("position", "velocity"):
        if len(content["joints"][name]) != chain.joints:
            raise ValueError(f"its arm has {chain.joints} joints, joints.{name} others")
    return content, chain, pairs


def score(scenario: Path, answer: Any) -> Score:
    """Judge an answer, as `judged` does, to the scenario in a file."""
    return judged(*load(scenario), answer)


def judged(content: dict[str, Any], chain: Chain, pairs: list[list[str]], answer: Any) -> Score:
    """Judge an answer to a scenario that `load` has returned; a malformed answer is a fault."""
    try:
        with np.errstate(all="ignore"):
            return _judged(content, chain, pairs, answer)
    except Exception as error:  # whatever extreme numbers lead to
        words = f"it cannot be judged: {type(error).__name__}: {error}"
        return Score(False, (words[:_LONGEST_REASON],))


def _judged(content: dict[str, Any], chain: Chain, pairs: list[list[str]], answer: Any) -> Score:
    if not isinstance(answer, dict):
        return Score(False, (f"no plan: not an object but {type(answer).__name__}",))
    if answer.get("status", "solved") != "solved":
        said = f"{answer['status']}: {answer.get('message', '')}".removesuffix(": ")
        return Score(False, (f"no plan: {said[:_LONGEST_REASON]}",))
    if fault := _ill_formed(chain, content, answer):
        return Score(False, (fault,))
    motion = joint_motion(answer)
    between = _between_moments(motion, answer["time"], float(content["duration"]))
    flight = flown(chain, content, motion)
    faults = [
        *_start_faults(content, flight),
        *between.faults(),
        *_limit_faults(chain, content, flight, between.rates),
    ]
    miss, turn, moving = _at_goal(chain, content, flight)
    faults += [f"the end effector {fault}" for fault in moving]
    sampled, certified = clearance(chain, content, flight, pairs)
    certified -= (
        between.aside * chain.reach
    )  # no point of the arm is further from where it was seen
    if certified < -CLEARANCE:
        faults.append(f"the clearance is {1e3 * certified:.2f} mm")
    turned = Rotation.from_matrix(flight.base.rotation[0].T @ flight.base.rotation)
    return Score(
        not faults,
        tuple(faults),
        certified if np.isfinite(certified) else None,
        sampled if np.isfinite(sampled) else None,
        miss,
        turn,
        float(np.trapezoid(np.linalg.norm(flight.rates, axis=1), flight.times)),
        float(turned.magnitude().max()),
    )


def _ill_formed(chain: Chain, scenario: dict[str, Any], answer: dict[str, Any]) -> str | None:
    """Return why an answer has no motion that can be judged; None: it has one."""
    if answer.get("joint_names", chain.joint_names) != chain.joint_names:
        return f"joint_names: {answer['joint_names']}, not {chain.joint_names}"
    try:
        if len(answer["time"]) > MOST_POINTS:
            return f"time: {len(answer['time'])} points, more than {MOST_POINTS}"
        time = np.asarray(answer["time"], float)
        for name in ("joint_positions", "joint_velocities", "joint_accelerations"):
            if name == "joint_accelerations" and name not in answer:
                continue
            rows = np.asarray(answer[name], float)
            if rows.shape != (time.size, chain.joints) or not (np.abs(rows) < _LARGEST).all():
                return f"{name}: not finite numbers, {chain.joints} for each of {time.size} times"
    except KeyError as error:
        return f"not readable: {error} is missing"
    except (TypeError, ValueError, OverflowError) as error:
        return f"not readable: {type(error).__name__}: {error}"
    late = float(scenario["duration"]) - 1e-6
    if time.ndim != 1 or time.size < 2 or not (np.abs(time) < _LARGEST).all() or time[0] != 0.0:
        return "time: not finite numbers from 0 on"
    if (np.diff(time) < 1e-6).any() or time[-1] < late:
        return "time: not increasing up to the duration"
    return None


class _Between(NamedTuple):
    """Deviations of an answer from the smooth motion through its positions at the moments."""

    aside: float  # largest sum of the joints' deviations [rad]
    faster: float  # largest deviation of a joint's velocity [rad/s]
    rates: Array  # largest velocity of each joint; shape (joints,) [rad/s]

    def faults(self) -> Iterator[str]:
        """Yield the deviations that are too large, in words."""
        if self.aside > UNSEEN:
            yield f"the joints move by {self.aside:.2e} rad between moments that do not show it"
        if self.faster > UNSEEN_RATE:
            yield f"rates are {self.faster:.2e} rad/s off those that belong to the positions"


def _between_moments(motion: BPoly, time: Any, duration: float) -> _Between:
    """Compare a motion with its smooth spline, at the answer's points and between them."""
    points, smooth = np.asarray(time, float), at_moments(motion, duration)
    parts = np.linspace(0.0, 1.0, _LOOKS, endpoint=False)
    looks = (points[:-1, None] + parts * np.diff(points)[:, None]).ravel()
    looks = np.append(looks[looks < duration], duration)
    rates = motion(looks, 1)
    return _Between(
        float(np.abs(motion(looks) - smooth(looks)).sum(axis=1).max()),
        float(np.abs(rates - smooth(looks, 1)).max()),
        np.abs(rates).max(axis=0),
    )


def _start_faults(scenario: dict[str, Any], flight: Flight) -> list[str]:
    told = scenario["joints"]
    pairs = (("positions", "position", flight.angles), ("rates", "velocity", flight.rates))
    return [
        f"the joints' first {what} are off by {off:.2e}"
        for what, name, rows in pairs
        if (off := float(np.abs(rows[0] - told[name]).max())) > START
    ]


def _limit_faults(
    chain: Chain, scenario: dict[str, Any], flight: Flight, rates: Array
) -> list[str]:
    limits, faults = scenario["limits"], []
    beyond = np.maximum(chain.lower - flight.angles, flight.angles - chain.upper).max()
    if beyond > POSITION:
        faults.append(f"a joint leaves its range by {beyond:.2e} rad")
    if limits["velocity"] == "from_urdf":
        rates = np.maximum(np.abs(flight.rates).max(axis=0), rates)
        part = float((rates / chain.fastest).max())
        if part > 1.0 + RATE:
            faults.append(f"a joint has {part:.3f} times its largest rate")
    if limits["effort"] == "from_urdf":
        part = float((np.abs(torques(chain, flight)) / chain.strongest).max())
        if part > 1.0 + TORQUE:
            faults.append(f"a joint needs {part:.3f} times its largest torque")
    return faults


def _at_goal(
    chain: Chain, scenario: dict[str, Any], flight: Flight
) -> tuple[float, float | None, list[str]]:
    """Return the errors of position and orientation at the end, and the faults there."""
    place, turn, velocity, rate = goal(scenario)
    tip = flight.of(flight.posture.links[chain.tip])
    twist = flight.twist_at(chain.tip, chain)[-1]
    off = Rotation.from_matrix(turn.T @ tip.rotation[-1]).as_rotvec()
    spin = twist[3:] - rate
    counts = scenario.get("target", {}).get("orientation", "fixed")
    if counts == "about_axis":
        axis = np.asarray(scenario["target"]["free_axis"], float)
        axis /= np.linalg.norm(axis)
        aside = np.cross(tip.rotation[-1] @ axis, turn @ axis)
        off, spin = aside, spin - (spin @ tip.rotation[-1] @ axis) * (tip.rotation[-1] @ axis)
    missed = float(np.linalg.norm(tip.position[-1] - place))
    wrong = [(missed, MISS, "misses by {:.2e} m")]
    wrong.append((float(np.linalg.norm(twist[:3] - velocity)), SPEED, "passes at {:.2e} m/s"))
    turned = None
    if counts != "free":
        turned = float(np.linalg.norm(off))
        wrong.append((turned, TURN, "is turned by {:.2e} rad"))
        wrong.append((float(np.linalg.norm(spin)), SPIN, "turns at {:.2e} rad/s"))
    return missed, turned, [text.format(value) for value, most, text in wrong if value > most]


def goal(scenario: dict[str, Any]) -> tuple[Array, Array, Array, Array]:
    """Return the goal of the end effector at the end of a scenario, in the inertial frame.

    Position [m], rotation to inertial axes, velocity [m/s] and angular velocity [rad/s].
    """
    if "target" in scenario:
        told = scenario["target"]
        moving = [np.asarray(told[name], float) for name in ("linear_velocity", "angular_velocity")]
        turn = Rotation.from_quat(told["quaternion_xyzw"]).as_matrix()
        return np.asarray(told["position"], float), turn, moving[0], moving[1]
    told = scenario["target_body"]
    body = body_motion(told, np.array([0.0, float(scenario["duration"])]))
    turn, rate = body.rotations[-1], body.rates[-1]
    lever = turn @ np.asarray(told["grasp"]["position"], float)
    velocity = np.asarray(told["linear_velocity"], float) + np.cross(rate, lever)
    grasp = turn @ Rotation.from_quat(told["grasp"]["quaternion_xyzw"]).as_matrix()
    return body.center[-1] + lever, grasp, velocity, rate


def errors_at_goal(
    chain: Chain, scenario: dict[str, Any], flight: Flight
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the tip's correction to the goal at the end, and which of its six numbers count.

    Translation [m] and rotation vector [rad], inertial. A method may use it to aim; the scorer does
    not.
    """
    place, turn, *_ = goal(scenario)
    tip = flight.of(flight.posture.links[chain.tip])
    turned = Rotation.from_matrix(turn @ tip.rotation[-1].T).as_rotvec()
    counts = np.ones(6, bool)
    counts[3:] = scenario.get("target", {}).get("orientation", "fixed") != "free"
    if scenario["robot"].get("base") == "planar":
        counts[2:5] = False
    return np.concatenate([place - tip.position[-1], turned]), counts
