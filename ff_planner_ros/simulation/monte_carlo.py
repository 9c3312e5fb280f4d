"""Monte Carlo of a plan under uncertain inertias and initial velocities.

A run is one random system (`uncertainty`) that executes the plan: its joints follow the plan, and
its base moves by conservation of momentum. A draw depends on the seed and the run's number alone.
First-order predictions by exact sensitivities stand beside the runs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.intervals import exact_interval
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.motion.sound_samples import require_sound_samples
from ff_planner_ros.planning.problem.problem import Limits
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.planning.problem.uncertainty import Draws, Uncertainty, directions, draws
from ff_planner_ros.planning.robust.base_spread import TrackedMotion, base_spread, tracked_motion
from ff_planner_ros.planning.robust.grasp_frames import grasp_frames
from ff_planner_ros.planning.robust.margins import (
    ATTITUDE,
    CLEARANCE,
    CORRIDOR,
    ROTATION,
    TORQUE,
    Margins,
    ee_by_errors,
    margins,
    rotated_since_start,
    turned_from_start,
)
from ff_planner_ros.planning.robust.nearness import Nearness, nearness
from ff_planner_ros.robot.kinematics import rotation_base_to_inertial
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.simulation.tracked_runs import TrackedRuns, run_torques, tracked_runs

# A thousand runs take about a second; memory holds so many at once.
MOST_RUNS, _AT_ONCE = 1_000_000, 250
_LIMITS = Limits()

# How a run executes a plan: a controller keeps the joints on it, or torques alone are given.
TRACKED, TORQUES = EXECUTIONS = ("tracked", "torques")
JOINTS = "joint_positions"
_ENDS = ("end_position_error", "end_orientation_error")
UNITS = {
    **dict(zip(_ENDS, ("m", "rad"), strict=True)),
    CLEARANCE: "m",
    ATTITUDE: "rad",
    ROTATION: "rad",
    CORRIDOR: "m",
    TORQUE: "N m",
    JOINTS: "rad",
}


class Distribution(NamedTuple):
    """Statistics of one quantity over runs."""

    rms: float
    mean: float
    std: float
    least: float
    percentile_1: float
    percentile_5: float
    median: float
    percentile_95: float
    percentile_99: float
    largest: float


@dataclass(frozen=True)
class Compared:
    """Statistics of one quantity in the runs, and to first order with the same errors."""

    name: str
    unit: str
    runs: Distribution
    linear: Distribution | None  # None: not predicted


@dataclass(frozen=True)
class Violations:
    """The number of runs that violate a constraint."""

    kind: str  # of constraint, as in `margins`; `joint_positions`; or `any`
    count: int  # runs with a violation
    total: int  # all runs
    linear: int | None  # violations to first order, with the same errors; None: not predicted

    @property
    def share(self) -> float:
        """The violating part of the runs, 0 to 1."""
        return self.count / self.total

    @property
    def interval(self) -> tuple[float, float]:
        """The exact 95 % confidence interval of the probability of a violation."""
        return exact_interval(self.count, self.total)


@dataclass(frozen=True, eq=False)
class MonteCarlo:
    """The result of executing a plan in many runs."""

    execution: str  # of `EXECUTIONS`
    total: int
    seed: int
    uncertainty: Uncertainty
    numbers: tuple[Compared, ...]
    violations: tuple[Violations, ...]  # the last one: of any kind
    # RMS error of the end effector at the goal, from the covariance [m, rad]; None: not predicted
    foretold_end_error: tuple[float, float] | None


def monte_carlo(
    robot: Robot,
    trajectory: Trajectory,
    scene: Scene,
    uncertainty: Uncertainty,
    total: int,
    seed: int = 0,
    limits: Limits = _LIMITS,
) -> MonteCarlo:
    """Execute a plan in `total` runs with its joints on the plan, each by another random system.

    Args:
        scene: In the plan's inertial frame.
        limits: Limits of the chaser's attitude and of torques, whose violations are counted.

    Raises:
        InvalidInput: The samples cannot be executed, the number of runs or the seed is out of
            range, or wheels hold the chaser.
    """
    require_sound_samples(robot, trajectory)
    require_runs(total, seed)
    if robot.wheels is not None:
        allowed = "with robot.base attitude_held it must be torques"
        raise InvalidInput(Status.UNSUPPORTED, "--execution", TRACKED, allowed)
    motion = tracked_motion(robot, trajectory)
    seen = scene.captured_at(float(trajectory.time[-1])).seen_from(motion.origin, motion.velocity)
    near = nearness(robot, motion.q, motion.time, seen)
    of = directions(robot, uncertainty)
    spread = base_spread(motion, of)
    kept = margins(motion, seen, near, limits, of, spread)
    goal = int(np.abs(motion.time - (seen.capture_time or 0.0)).argmin())
    end_by_errors = ee_by_errors(motion, spread)[goal]
    measured: list[dict[str, Array]] = []
    errors: list[Array] = []
    for first in range(0, total, _AT_ONCE):
        drawn = draws(robot, uncertainty, range(first, min(first + _AT_ONCE, total)), seed)
        runs = tracked_runs(motion, drawn)
        errors.append(drawn.errors)
        measured.append(
            _end_errors(motion, runs, goal)
            | dict(_least_margins(motion, seen, near, limits, kept, drawn, runs))
        )
    found = {name: np.concatenate([one[name] for one in measured]) for name in measured[0]}
    drawn_errors = np.concatenate(errors)
    linear = {
        name: np.linalg.norm(drawn_errors @ rows.T, axis=1)
        for name, rows in zip(_ENDS, np.split(end_by_errors, 2), strict=True)
    } | {one.kind: one.least(drawn_errors) for one in kept}
    expected = tuple(float(np.linalg.norm(rows)) for rows in np.split(end_by_errors, 2))
    return MonteCarlo(
        execution=TRACKED,
        total=total,
        seed=seed,
        uncertainty=uncertainty,
        numbers=tuple(
            Compared(name, UNITS[name], distribution(values), distribution(linear[name]))
            for name, values in found.items()
        ),
        violations=violations(
            {name: found[name] for name in found if name not in _ENDS},
            {name: linear[name] for name in linear if name not in _ENDS},
            total,
        ),
        foretold_end_error=(expected[0], expected[1]),
    )


def require_runs(total: int, seed: int) -> None:
    """Refuse a number of runs or a seed out of range.

    Raises:
        InvalidInput: One of them is.
    """
    if not 1 <= total <= MOST_RUNS:
        allowed = f"it must be at least 1 and at most {MOST_RUNS}"
        raise InvalidInput(Status.OUT_OF_RANGE, "--monte-carlo", total, allowed)
    if seed < 0:
        raise InvalidInput(Status.OUT_OF_RANGE, "--seed", seed, "it must not be negative")


def distribution(values: Array) -> Distribution:
    """Return the statistics of values, shape (runs,)."""
    with np.errstate(invalid="ignore"):  # of runs that diverged
        percentiles = np.percentile(values, [0.0, 1.0, 5.0, 50.0, 95.0, 99.0, 100.0])
        std = float(values.std())
    return Distribution(
        rms=float(np.sqrt(np.mean(values**2))),
        mean=float(values.mean()),
        std=std,
        **dict(zip(Distribution._fields[3:], percentiles.tolist(), strict=True)),
    )


def violations(
    least: dict[str, Array], linear: dict[str, Array] | None, total: int
) -> tuple[Violations, ...]:
    """Count the runs whose least margin is negative, of each kind and of any.

    Args:
        least: Least margin of each run, by kind. Shape (runs,) each.
        linear: The same to first order; None: not predicted.
    """
    found, any_, any_linear = [], np.zeros(total, bool), np.zeros(total, bool)
    for kind, margin in least.items():
        foretold = None
        if linear is not None:
            any_linear |= linear[kind] < 0.0
            foretold = int((linear[kind] < 0.0).sum())
        any_ |= margin < 0.0
        found.append(Violations(kind, int((margin < 0.0).sum()), total, foretold))
    foretold = None if linear is None else int(any_linear.sum())
    return (*found, Violations("any", int(any_.sum()), total, foretold))


def _end_errors(motion: TrackedMotion, runs: TrackedRuns, goal: int) -> dict[str, Array]:
    """Return the end effector's errors from the plan at the goal. Shape (runs,) each."""
    base = rotation_base_to_inertial(motion.q[goal : goal + 1])[0]
    planned = arm_points(motion.robot, motion.q[goal : goal + 1])[0, -1]
    in_base = base.T @ (planned - motion.q[goal, :3])
    off = runs.positions[goal] + runs.rotations[goal] @ in_base - planned
    turned = Rotation.from_matrix(runs.rotations[goal] @ base.T).magnitude()
    return dict(zip(_ENDS, (np.linalg.norm(off, axis=1), turned), strict=True))


def _least_margins(
    motion: TrackedMotion,
    scene: Scene,
    near: Nearness,
    limits: Limits,
    kept: list[Margins],
    drawn: Draws,
    runs: TrackedRuns,
) -> Iterator[tuple[str, Array]]:
    """Yield kind and least margin of each run, shape (runs,), for the kinds in `kept`."""
    for kind in (one.kind for one in kept):
        if kind == CLEARANCE:
            yield kind, near.least(runs.rotations, runs.positions)
        elif kind == ATTITUDE:
            turned = np.abs(turned_from_start(motion, runs.rotations)).max(axis=(0, 2))
            yield kind, limits.chaser_attitude - turned
        elif kind == ROTATION:
            turned = rotated_since_start(motion, runs.rotations).max(axis=0)
            yield kind, limits.chaser_rotation - turned
        elif kind == TORQUE:
            efforts = motion.robot.effort_limits
            torques = np.abs(run_torques(motion, drawn, runs))
            yield kind, (efforts - torques).min(axis=(1, 2))
        else:
            yield kind, _least_in_corridor(motion, scene, runs)


def _least_in_corridor(motion: TrackedMotion, scene: Scene, runs: TrackedRuns) -> Array:
    frames = grasp_frames(scene, motion.robot.base, motion.time)
    if frames is None or scene.approach is None:
        return np.full(runs.positions.shape[1], np.inf)
    base = rotation_base_to_inertial(motion.q)
    in_base = np.einsum(
        "tji,tj->ti", base, arm_points(motion.robot, motion.q)[:, -1] - motion.q[:, :3]
    )
    points = runs.positions + np.einsum("trij,tj->tri", runs.rotations, in_base)
    places = frames.sees(points[: frames.until])
    inside = scene.approach.margins(places.reshape(-1, 3)).values
    least: Array = inside.reshape(places.shape[:2]).min(axis=0)
    return least
