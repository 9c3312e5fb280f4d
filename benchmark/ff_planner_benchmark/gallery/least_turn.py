"""The least last turn of P1 that its velocities allow, by direct optimisation: a bound for plans.

Joint velocities are constant in each of some equal intervals, and jump between them: neither rest
at the ends, nor accelerations, nor torques limit them. SciPy's SLSQP makes the last turn small.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.optimize import minimize

from ff_planner_benchmark.gallery.motions import at_start, ee_pose
from ff_planner_benchmark.gallery.recomputed import PLANAR_START, model
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.forward import carried_base
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.robot.model import Base

_DURATION, _GOAL = 4.99, np.array([1.0, 0.0])
_STEPS = 4  # of Runge-Kutta in an interval
_SMALL = 1e-6  # step of finite differences [rad/s]


def least_last_turns(intervals: int, starts: int) -> Array:
    """Return the least last turns from so many random initial guesses. Shape (starts,) [deg]."""
    robot = model("cbk_planar", Base.PLANAR, "satellite")
    limits = np.tile(robot.velocity_limits, intervals)
    time = np.linspace(0.0, _DURATION, intervals + 1)

    def reached(rates: Array) -> Array:
        """Return last turn [deg] and place [m]: shape (3,)."""
        q = at_start(robot, PLANAR_START)
        for rate, begin, end in zip(rates.reshape(intervals, -1), time, time[1:], strict=False):
            ends = np.array([q[7:], q[7:] + (end - begin) * rate])
            steady = np.array([rate, rate])
            joints = JointMotion(np.array([begin, end]), ends, steady, np.zeros_like(ends))
            steps = np.linspace(begin, end, _STEPS + 1)
            q = carried_base(robot, q, np.zeros(6), joints, steps)[0][-1]
        turn = np.rad2deg(2.0 * np.arctan2(q[5], q[6]))
        return np.array([turn, *ee_pose(robot, q).translation[:2]])

    @lru_cache(maxsize=2)
    def sensitive(kept: bytes) -> tuple[Array, Array]:
        rates = np.frombuffer(kept)
        there = reached(rates)
        moved = [reached(rates + one) - there for one in _SMALL * np.eye(len(rates))]
        return there, np.array(moved).T / _SMALL

    rng, found = np.random.default_rng(1), list[float]()
    for _ in range(starts):
        solved = minimize(
            lambda rates: sensitive(rates.tobytes())[0][0] ** 2,
            rng.uniform(-limits, limits),
            jac=lambda rates: (
                2.0 * sensitive(rates.tobytes())[0][0] * sensitive(rates.tobytes())[1][0]
            ),
            bounds=list(zip(-limits, limits, strict=True)),
            constraints={
                "type": "eq",
                "fun": lambda rates: sensitive(rates.tobytes())[0][1:] - _GOAL,
                "jac": lambda rates: sensitive(rates.tobytes())[1][1:],
            },
            method="SLSQP",
        )
        found.append(abs(float(reached(solved.x)[0])))
    return np.array(found)
