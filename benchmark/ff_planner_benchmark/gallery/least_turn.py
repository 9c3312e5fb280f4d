"""The least last turn of P1 within its velocities and torques, by direct optimisation.

The accelerations of the joints are constant in each of some equal intervals. The system rests at
the start, the end effector at the end. Body k turns at w_k, and b_ik is that part of the way from
the system's centre of mass to that of body i which turns with body k:

    energy 1/2 sum w_k w_l D_kl,   D_kl = I_k [k = l] + sum over i of m_i b_ik . R(a_l - a_k) b_il.

Without momentum sum_kl D_kl w_l = 0, which gives the satellite's turn, and Lagrange's equations the
torques. SciPy's SLSQP makes the last turn small; derivatives are by complex steps.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.optimize import minimize

from ff_planner_benchmark.gallery.recomputed import PLANAR_START, model
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.model import Base

_DURATION, _GOAL = 4.99, np.array([1.0, 0.0])
_GAUSS, _WEIGHTS = (0.5 - np.sqrt(0.15), 0.5, 0.5 + np.sqrt(0.15)), np.array([5.0, 8.0, 5.0]) / 18.0
_TURNED = np.array([[0.0, -1.0], [1.0, 0.0]])


class PlanarTestbed:
    """The testbed of P1 without momentum, in its own words: angles of bodies in a plane."""

    def __init__(self) -> None:
        """Take masses and lengths from the model."""
        self.robot = model("cbk_planar", Base.PLANAR, "satellite")
        of = self.robot.model
        bodies = list(of.inertias[1:])
        tip = of.frames[self.robot.tip_frame_id].placement.translation[:2]
        steps = [one.translation[:2] for one in of.jointPlacements[2:]]
        count = len(bodies)
        ways = np.zeros((count + 1, count, 2))  # to each centre of mass and the tip, by turned part
        for number in range(count + 1):
            for joint, step in enumerate(steps[: min(number, count - 1)]):
                ways[number, joint] = step
        for number, body in enumerate(bodies):
            ways[number, number] = body.lever[:2]
        ways[count, count - 1] = tip
        masses = np.array([body.mass for body in bodies])
        self._middle = np.einsum("i,ikx->kx", masses, ways[:count]) / masses.sum()
        apart = ways[:count] - self._middle
        self._tip = ways[count] - self._middle
        self._even = np.einsum("i,ikx,ilx->kl", masses, apart, apart)
        self._odd = np.einsum("i,ikx,xy,ily->kl", masses, apart, _TURNED, apart)
        self._own = np.diag([float(body.inertia[2, 2]) for body in bodies])

    def motion(self, joints: Array, rates: Array, accelerations: Array) -> tuple[Array, Array]:
        """Return the satellite's angular velocity and the joints' torques. (...), (..., 3)."""
        angles, turning, speeding = (_summed(one) for one in (joints, rates, accelerations))
        apart = angles[..., None, :] - angles[..., :, None]
        cosine, sine = np.cos(apart), np.sin(apart)
        inertia = self._even * cosine + self._odd * sine + self._own
        slope = self._odd * cosine - self._even * sine
        of_base, whole = inertia.sum(axis=-1), inertia.sum(axis=(-1, -2))
        turn = -(of_base * turning).sum(axis=-1) / whole
        by_speed = (slope @ ((turning + turn[..., None]) ** 2)[..., None])[..., 0]
        sped = -((of_base * speeding).sum(axis=-1) + by_speed.sum(axis=-1)) / whole
        forces = (inertia @ (speeding + sped[..., None])[..., None])[..., 0] + by_speed
        return turn, np.cumsum(forces[..., ::-1], axis=-1)[..., -2::-1]

    def hand(self, joints: Array, rates: Array, base: Array, turn: Array) -> Array:
        """Return place and velocity of the end effector. Shape (..., 4) [m, m/s]."""
        angles, turning = _summed(joints) + base[..., None], _summed(rates) + turn[..., None]
        along = _rotated(angles, self._tip)
        across = (along * turning[..., None]) @ _TURNED.T
        begin = _rotated(_summed(PLANAR_START), self._middle).sum(axis=-2)
        return np.concatenate([along.sum(axis=-2) + begin, across.sum(axis=-2)], axis=-1)


def least_last_turns(intervals: int, starts: int, within_torques: bool) -> Array:
    """Return the least last turns from so many random initial guesses. Shape (starts,) [deg].

    Args:
        within_torques: Whether the torques are limited, too.
    """
    testbed, step = PlanarTestbed(), _DURATION / intervals
    robot = testbed.robot
    within = np.array([*_GAUSS, 0.0, 1.0])[:, None] * step

    def outcome(accelerations: Array) -> Array:
        """Return turn [deg] and hand [m, m/s] at the end, then parts of limits."""
        constant = accelerations.reshape(*accelerations.shape[:-1], intervals, 1, -1)
        rates = _from_zero(constant[..., 0, :] * step)
        joints = _from_zero((rates[..., :-1, :] + rates[..., 1:, :]) * step / 2.0) + PLANAR_START
        begin, rate = joints[..., :-1, None, :], rates[..., :-1, None, :]
        there = begin + rate * within + constant * within**2 / 2.0
        turn, torques = testbed.motion(there, rate + constant * within, 0.0 * there + constant)
        base = (turn[..., :3] @ _WEIGHTS).sum(axis=-1) * step
        hand = testbed.hand(joints[..., -1, :], rates[..., -1, :], base, turn[..., -1, -1])
        parts = [rates[..., 1:, :] / robot.velocity_limits]
        if within_torques:
            parts += [torques[..., at, :] / robot.effort_limits for at in (1, 3, 4)]
        flat = [one.reshape(*accelerations.shape[:-1], -1) for one in parts]
        return np.concatenate([base[..., None] * 180.0 / np.pi, hand, *flat], axis=-1)

    fastest = np.tile(robot.velocity_limits, intervals) / step
    tiny = 1e-30

    @lru_cache(maxsize=2)
    def sensitive(kept: bytes) -> tuple[Array, Array]:
        x = np.frombuffer(kept)
        slopes = outcome(fastest * (x + 1j * tiny * np.eye(len(x)))).imag.T / tiny
        return outcome(fastest * x), slopes

    def part(number: int, of: Callable[[Array], Any]) -> Callable[[Array], Any]:
        return lambda x: of(sensitive(x.tobytes())[number])

    goal = np.concatenate([_GOAL, np.zeros(2)])
    kept = [
        {"type": "eq", "fun": part(0, lambda f: f[1:5] - goal), "jac": part(1, lambda f: f[1:5])},
        {"type": "ineq", "fun": part(0, lambda f: 1.0 - f[5:]), "jac": part(1, lambda f: -f[5:])},
        {"type": "ineq", "fun": part(0, lambda f: 1.0 + f[5:]), "jac": part(1, lambda f: f[5:])},
    ]
    rng, found = np.random.default_rng(1), list[float]()
    for _ in range(starts):
        solved = minimize(
            part(0, lambda f: f[0] ** 2),
            rng.uniform(-0.1, 0.1, len(fastest)),
            jac=lambda x: 2.0 * sensitive(x.tobytes())[0][0] * sensitive(x.tobytes())[1][0],
            constraints=kept,
            method="SLSQP",
        )
        found.append(abs(float(outcome(fastest * solved.x)[0])))
    return np.array(found)


def _summed(values: Array) -> Array:
    """Return a zero for the satellite, and for each link the sum of the joints before it."""
    return _from_zero(values[..., None])[..., 0]


def _from_zero(steps: Array) -> Array:
    """Return the sums of steps along the last axis but one, a zero first."""
    summed = np.cumsum(steps, axis=-2)
    return np.concatenate([np.zeros_like(summed[..., :1, :]), summed], axis=-2)


def _rotated(angles: Array, ways: Array) -> Array:
    """Return ways in the plane, turned by an angle each. Shape (..., ways, 2)."""
    cosine, sine = np.cos(angles)[..., None], np.sin(angles)[..., None]
    rotated: Array = cosine * ways + sine * (ways @ _TURNED.T)
    return rotated
