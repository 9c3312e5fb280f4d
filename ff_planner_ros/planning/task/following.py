"""The task of a phase that follows: it begins where the plan of the phase before ends."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pinocchio as pin

from ff_planner_ros.errors import fields_placed
from ff_planner_ros.planning.check.preconditions import require_askable
from ff_planner_ros.planning.motion.motion import state_at
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.objective import DurationRange
from ff_planner_ros.planning.problem.obstacles import carried, with_attached
from ff_planner_ros.planning.problem.posture import Posture, end_effector_at
from ff_planner_ros.planning.problem.problem import PlanningProblem, lasting
from ff_planner_ros.planning.problem.target import Target
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.planning.search.families import require_families
from ff_planner_ros.planning.task.phase import require_mass
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.configuration import eigen_quaternion
from ff_planner_ros.robot.impact import impact
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.robot.urdf.payload import HeldShape, Payload, with_payload


def following(task: PlanningTask, plan: Plan) -> PlanningTask:
    """Return the task of the next phase, from the predicted end of a plan, contact included.

    Args:
        task: Task of the phase that `plan` is for, with at least one phase in `then`.

    Raises:
        InvalidInput: The phase cannot begin there: the captured body has no mass, say.
    """
    return _following(task, end_state(plan), plan.duration)


def require_askable_phases(task: PlanningTask) -> None:
    """Refuse what no plan of any phase can be asked for, before there is one.

    The phases that follow are looked at as if those before ended where they begin, soonest.

    Raises:
        InvalidInput: A phase is refused; fields of those that follow begin with `phases[1]`.
    """
    _require_askable(task.problem)
    for number in range(1, 1 + len(task.then)):
        with fields_placed(f"phases[{number}]"):
            task = _following(task, task.problem.start, task.problem.durations.minimum)
            _require_askable(task.problem)


def _require_askable(problem: PlanningProblem) -> None:
    require_families(problem)
    require_askable(problem)


def _following(task: PlanningTask, end: SystemState, duration: float | None) -> PlanningTask:
    """Return the task of the next phase, from where the one before ends, and when."""
    phase, *rest = task.then
    before = lasting(task.problem, duration)
    elapsed = before.duration
    robot, start = _holding(before, end, phase.payload)
    obstacles = carried([one for one in before.obstacles if one.body is None], elapsed)
    window = phase.duration if isinstance(phase.duration, DurationRange) else None
    lasts = phase.longest_duration
    body = None if phase.target_body is None else phase.target_body.after(elapsed)
    posture = phase.target if isinstance(phase.target, Posture) else None
    if body is not None:
        target, obstacles = body.target(lasts), with_attached(obstacles, body)
    elif isinstance(phase.target, Target):
        target = phase.target
    else:
        target = end_effector_at(robot, start)
    problem = replace(
        before,
        robot=robot,
        start=start,
        target=target,
        posture=posture,
        path=None,
        target_body=body,
        chaser_goal=phase.chaser_goal,
        obstacles=obstacles,
        duration=lasts,
        duration_range=window,
        objective=phase.objective or before.objective,
        limits=phase.limits or before.limits,
        points=phase.points or before.points,
        parametrisation=phase.parametrisation or before.parametrisation,
        approach=phase.approach,
        camera=phase.camera,
        allowed_collisions=phase.allowed_collisions,
        contact_distance=phase.contact_distance,
    )
    return replace(
        task,
        problem=problem,
        ahead=0.0,
        running=None,
        running_goal=None,
        first_guess=None,
        effort=phase.effort,
        then=tuple(
            one
            if one.target_body is None
            else replace(one, target_body=one.target_body.after(elapsed))
            for one in rest
        ),
    )


def phase_tasks(task: PlanningTask, plan: Plan) -> Iterator[tuple[PlanningTask, Plan]]:
    """Yield the task of each phase with its plan."""
    for number, one in enumerate(plan.phases):
        yield task, one
        if number + 1 < len(plan.phases):
            task = following(task, one)


def end_state(plan: Plan) -> SystemState:
    """Return the state of chaser and arm at the last point of a plan."""
    state = state_at(plan.trajectory, -1)
    if plan.wheels is not None:
        state = replace(state, wheel_momenta=plan.wheels.momenta[-1])
    return state


def _holding(
    before: PlanningProblem, end: SystemState, given: Payload | None
) -> tuple[Robot, SystemState]:
    """Return the robot with what it holds from now on, and its state then."""
    robot, body = before.robot, before.target_body
    if body is None:
        return (robot if given is None else with_payload(robot, given)), end
    require_mass(body)
    payload = given or held_body(body, robot)
    touching = [pair.partition("/")[0] for pair in before.allowed_collisions]
    twist = body.grasp(np.array([before.duration])).twists[0]
    after = impact(robot, body.inertia_at_grasp, end, twist).after
    return with_payload(robot, payload, touching), after


def held_body(body: TargetBody, robot: Robot) -> Payload:
    """Return a captured body as a payload of the end effector, held at its grasp."""
    to_body = pin.Quaternion(body.grasp_quaternion_xyzw).toRotationMatrix()
    shapes, inertia = list[HeldShape](), body.inertia_at_grasp
    for one in body.obstacles if robot.geometry is Geometry.SHAPES else ():
        turn = to_body.T @ pin.Quaternion(one.quaternion_xyzw).toRotationMatrix()
        quaternion = pin.Quaternion(eigen_quaternion(turn)).normalized().coeffs()
        place = (one.position - body.grasp_position) @ to_body
        shapes.append(HeldShape(one.id, one.shape, place, quaternion))
    return Payload(
        link=robot.tip_link,
        mass=inertia.mass,
        inertia=inertia.inertia,
        center_of_mass=inertia.lever,
        shapes=tuple(shapes),
    )
