"""The plans of a sequence's phases as one plan, for the controller and for reports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from itertools import chain

import numpy as np

from ff_planner_ros.errors import FfPlannerError, NoPlanFound
from ff_planner_ros.planning.motion.metrics import Metrics
from ff_planner_ros.planning.motion.plan import Plan, RobustReport, SolverReport
from ff_planner_ros.planning.problem.problem import lasting
from ff_planner_ros.planning.problem.scene import Scene, scene_of
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.planning.task.planning_task import PlanningTask

# Metrics of which all phases' sum counts; else the largest counts, of those named `min_` the least.
_SUMS = ("joint_path_length", "penalty")


def whole(plan: Plan) -> Plan:
    """Return the plans of all phases joined to one plan; a plan of one phase stays as it is.

    The point that two phases share is the end of the first; joint velocities may jump there by the
    contact. Metrics are sums or the worst of all phases; the chaser's rotation is measured from the
    start of each phase. The joined plan has no decision variables.
    """
    if not plan.then:
        return plan
    phases, begins = plan.phases, plan.begins
    motion = phases[0].trajectory
    for begin, one in zip(begins[1:], phases[1:], strict=False):
        motion = motion.followed_by(one.trajectory, begin)
    wheels = phases[0].wheels
    for one in phases[1:]:
        if wheels is not None and one.wheels is not None:
            wheels = wheels.followed_by(one.wheels)
    return Plan(
        joint_names=plan.joint_names,
        trajectory=motion,
        xi=np.empty(0),
        orientation_reading="",
        metrics=_metrics([one.metrics for one in phases], begins),
        solver=_solver([one.solver for one in phases]),
        duration=begins[-1] + (phases[-1].duration or 0.0),
        robust=_robust([one.robust for one in phases if one.robust is not None]),
        wheels=wheels,
        effort=plan.effort,
        notes=tuple(dict.fromkeys(note for one in phases for note in one.notes)),
        turn_rate_at_rest=phases[-1].turn_rate_at_rest,
    )


def whole_scene(task: PlanningTask, plan: Plan) -> Scene:
    """Return the scene of all phases: that of the first, with the body that a phase captures.

    A body that a later phase captures replaces the goal, approach and camera of the first.
    """
    scene, bodies = scene_of(lasting(task.problem, plan.duration)), captured_bodies(task)
    phase = next((k for k, one in enumerate(bodies[: len(plan.phases)]) if one is not None), None)
    if phase is None:
        return scene
    if phase > 0:
        goal = plan.begins[phase] + (plan.phases[phase].duration or 0.0)
        scene = Scene(scene.obstacles, target_body=bodies[phase], capture_time=goal)
    later = plan.begins[phase + 1 :]
    return replace(scene, held_from=later[0]) if later else scene


def captured_bodies(task: PlanningTask) -> list[TargetBody | None]:
    """Return the body that each phase captures, in its state at the first point of the first."""
    return [task.problem.target_body, *(phase.target_body for phase in task.then)]


def efforts_of(answer: Plan | FfPlannerError) -> list[int]:
    """Return the step at which the search of each phase was cut short; zero: it was not.

    Of a refusal, the last one is that of the phase that was refused.
    """
    found = answer if isinstance(answer, Plan) else getattr(answer, "found", None)
    efforts = [one.effort for one in found.phases] if isinstance(found, Plan) else []
    if isinstance(answer, NoPlanFound):
        efforts.append(answer.effort)
    return efforts


def bodies_of(task: PlanningTask, plan: Plan) -> list[TargetBody | None]:
    """Return the body that each phase of a plan captures, at the phase's first point."""
    pairs = zip(captured_bodies(task), plan.begins, strict=False)
    return [None if body is None else body.after(begin) for body, begin in pairs]


def _metrics(each: Sequence[Metrics], begins: Sequence[float]) -> Metrics:
    found = {}
    for item in fields(Metrics):
        values = [getattr(one, item.name) for one in each]
        if item.name in _SUMS:
            found[item.name] = sum(values)
        elif isinstance(values[0], tuple):
            found[item.name] = tuple(np.max(values, axis=0).tolist())
        elif not item.name.endswith(("_pair", "_time")):
            if item.name.startswith("min_"):
                found[item.name] = min(values)
            else:  # infinite where a phase has no such thing
                found[item.name] = max(filter(np.isfinite, values), default=values[0])
    for name in ("min_clearance", "min_self_clearance"):
        worst = int(np.argmin([getattr(one, name) for one in each]))
        found[f"{name}_pair"] = getattr(each[worst], f"{name}_pair")
        found[f"{name}_time"] = begins[worst] + getattr(each[worst], f"{name}_time")
    return Metrics(**found)


def _robust(each: Sequence[RobustReport]) -> RobustReport | None:
    """Return the largest back-off of all phases, and their price; None: it was not asked for."""
    if not each:
        return None

    def largest(name: str) -> tuple[tuple[str, float], ...]:
        found: dict[str, float] = {}
        for of, amount in chain.from_iterable(getattr(one, name) for one in each):
            found[of] = max(amount, found.get(of, 0.0))
        return tuple(found.items())

    return replace(
        each[0],
        least_sigmas=min(one.least_sigmas for one in each),
        rounds=sum(one.rounds for one in each),
        plain_joint_path_length=sum(one.plain_joint_path_length for one in each),
        clearance=largest("clearance"),
        chaser_attitude=max(one.chaser_attitude for one in each),
        torques=largest("torques"),
        corridor=max(one.corridor for one in each),
        chaser_rotation=max(one.chaser_rotation for one in each),
    )


def _solver(each: Sequence[SolverReport]) -> SolverReport:
    counts = ("starts", "iterations", "rollouts")
    return replace(
        each[-1],
        **{name: sum(getattr(one, name) for one in each) for name in counts},
        optimality=max(one.optimality for one in each),
        stop_reason="; ".join(dict.fromkeys(one.stop_reason for one in each)),
    )
