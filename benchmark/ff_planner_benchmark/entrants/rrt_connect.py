"""OMPL's RRT-Connect on the free-floating system: an example of a method from outside.

RRT-Connect finds a joint path, with the chaser where it is along the straight path. Its spline is
rolled out, and its end corrected until it meets the goal; a motion that collides is discarded.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
from ompl import base, geometric, util
from scipy.interpolate import CubicSpline

from ff_planner_benchmark.scorer.chain import Array, Chain
from ff_planner_benchmark.scorer.clearance import from_lines, obstacles
from ff_planner_benchmark.scorer.flight import Flight, flown, joint_motion, tip_map
from ff_planner_benchmark.scorer.score import errors_at_goal, goal, load, score

STEPS, POINTS, ROUNDS, BENDS = 100, 60, 25, 3
# Margin to spheres [m]: the spline cuts corners, and a body is thicker than its line.
MARGIN = {"lines": 0.03, "shapes": 0.12}


def answer(scenario: Path, seconds: float) -> dict[str, Any]:
    """Try end postures until one can be reached, or the processor time is over."""
    util.noOutputHandler()
    util.RNG.setSeed(1)
    content, chain, _ = load(scenario)
    rng, begun, turn = np.random.default_rng(0), time.process_time(), 0.0
    first = np.array(content["joints"]["position"])
    while time.process_time() - begun < 0.9 * seconds:
        end = first + turn * rng.normal(size=chain.joints)
        turn = min(turn + 0.2, 1.5)
        aimed = _aimed(chain, content, np.array([first, np.clip(end, chain.lower, chain.upper)]))
        if aimed is None:
            continue
        flight, motion = aimed
        if not score(scenario, motion).faults:
            return motion
        left = 0.9 * seconds - (time.process_time() - begun)
        way = _rrt_connect(chain, content, flight, min(left, seconds / 4)) if left > 0.0 else None
        aimed = None if way is None else _aimed(chain, content, way)
        if aimed and not score(scenario, aimed[1]).faults:
            return aimed[1]
    return {"status": "no_plan"}


def _aimed(
    chain: Chain, content: dict[str, Any], way: Array
) -> tuple[Flight, dict[str, Any]] | None:
    """Correct the end of a joint path until the end effector meets the goal's pose and twist."""
    moving = np.concatenate(goal(content)[2:])
    last, part = np.zeros(chain.joints), np.linspace(0.0, 1.0, len(way))
    for _ in range(ROUNDS):
        motion = _motion(content, way, last)
        flight = flown(chain, content, joint_motion(motion), STEPS)
        offset, counts = errors_at_goal(chain, content, flight)
        jacobian, twist = tip_map(chain, flight)
        slow, inverse = moving - twist, np.linalg.pinv(jacobian[counts], rcond=1e-3)
        if max(np.abs(offset[counts]).max(), np.abs(slow[counts]).max()) < 1e-4:
            return flight, motion
        step = np.clip(inverse @ offset[counts], -0.4, 0.4)
        way, last = way + part[:, None] * step, last + inverse @ slow[counts]
        if np.abs(way).max() > 10.0 or np.abs(last).max() > 2.0:
            return None
    return None


def _motion(content: dict[str, Any], way: Array, last: Array) -> dict[str, Any]:
    duration, rates = content["duration"], content["joints"]["velocity"]
    spline = CubicSpline(np.linspace(0.0, duration, len(way)), way, bc_type=((1, rates), (1, last)))
    times = np.linspace(0.0, duration, POINTS)
    rows = {"joint_positions": spline(times), "joint_velocities": spline(times, 1)}
    return {"time": times.tolist()} | {name: value.tolist() for name, value in rows.items()}


def _rrt_connect(
    chain: Chain, content: dict[str, Any], straight: Flight, seconds: float
) -> Array | None:
    """Return a few joint positions from the start to the end of a flight, around the spheres."""
    margin, spheres = MARGIN[content["robot"]["geometry"]], list(obstacles(content, straight.times))
    begin, end = straight.angles[0], straight.angles[-1]

    def free(state: Any) -> bool:
        joints = np.array([state[joint] for joint in range(chain.joints)])
        along = (joints - begin) @ (end - begin) / max((end - begin) @ (end - begin), 1e-9)
        at = round(float(np.clip(along, 0.0, 1.0)) * STEPS)
        points = chain.points(chain.posture(joints[None]))[0]
        seen = points @ straight.base.rotation[at].T + straight.base.position[at]
        return all(from_lines((seen - s.centers[at])[None])[0] > s.radius + margin for s in spheres)

    space, bounds = base.RealVectorStateSpace(chain.joints), base.RealVectorBounds(chain.joints)
    for joint in range(chain.joints):
        bounds.setLow(joint, max(chain.lower[joint], -np.pi))
        bounds.setHigh(joint, min(chain.upper[joint], np.pi))
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    setup.setStateValidityChecker(free)
    states = [space.allocState(), space.allocState()]
    for state, joints in zip(states, (begin, end), strict=True):
        for joint, angle in enumerate(joints):
            state[joint] = float(angle)
    setup.setStartAndGoalStates(*states)
    setup.setPlanner(geometric.RRTConnect(setup.getSpaceInformation()))
    setup.solve(seconds)
    if not setup.haveExactSolutionPath():
        return None
    setup.simplifySolution()
    setup.getSolutionPath().interpolate(BENDS + 2)
    return np.array(
        [[s[j] for j in range(chain.joints)] for s in setup.getSolutionPath().getStates()]
    )
