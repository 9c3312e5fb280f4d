"""Problems that ask for everything at once: their witnesses keep all of it, and so do plans."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from judging import require_sound

from ff_planner_benchmark.problems import all_features
from ff_planner_benchmark.problems.tumbling_witness import Witness, tip
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.motion import chaser_euler
from ff_planner_ros.planning.motion.system_frame import in_own_frame, system_frame
from ff_planner_ros.planning.problem.problem import lasting
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.bodies import Swept, own_gap, sphere_gap
from ff_planner_ros.problems.drawn import Drawn
from ff_planner_ros.robot.collision.geometry import Geometry

SETTINGS = load_parameters().planner


@pytest.mark.parametrize("number", range(4))
def test_a_witness_keeps_everything_that_is_asked_for(number: int) -> None:
    drawn = all_features.problem(number)
    problem, witness = drawn.problem, drawn.witness
    robot, limits, window = problem.robot, problem.limits, problem.durations
    assert robot.geometry is Geometry.SHAPES
    lasts = float(witness.times[-1])
    assert window.minimum < lasts < window.maximum
    euler = float(np.abs(chaser_euler(robot, witness.way)).max())
    assert 0.9 * limits.chaser_attitude < euler < limits.chaser_attitude
    assert (witness.torques <= robot.effort_limits).all()
    assert limits.joint_velocities
    assert limits.joint_torques
    assert limits.joint_accelerations is not None
    # At its end the end effector holds the body's grasp, in whatever frame that is seen.
    own = in_own_frame(problem)
    at_end = lasting(own, lasts)
    began = own.start.position_chaser_in_inertial
    velocity = own.start.linear_velocity_chaser_in_inertial
    drift = _velocity_of_chaser(drawn) - velocity  # of the system's centre of mass, as drawn
    end = tip(robot, witness.way[-1])
    assert end.translation == pytest.approx(
        at_end.target.position - began + drift * lasts, abs=1e-5
    )
    turn = pin.Quaternion(end.rotation).angularDistance(
        pin.Quaternion(np.array(at_end.target.quaternion_xyzw))
    )
    assert turn < 1e-5
    # Away from every sphere by 2 cm, but for what frames leave of the digits, and from itself.
    swept = Swept(robot, witness.way)
    assert own_gap(swept, 0.01) >= 0.01
    for sphere in (one for one in own.obstacles if one.is_sphere):
        if sphere.body is None:
            centers = sphere.center + witness.times[:, None] * sphere.motion.velocity
        else:
            centers = sphere.body.places(sphere.motion.lever[None], witness.times)[:, 0]
        seen = centers - began + np.outer(witness.times, drift)
        assert sphere_gap(swept, sphere, 0.05, seen) >= 0.02 - 1e-5
    # And in its corridor, or further away than that is long.
    assert problem.approach is not None
    grasp = witness.body.grasp(witness.times)
    tips = np.array([tip(robot, q).translation for q in witness.way])
    places = ((tips - grasp.positions)[:, None] @ grasp.rotations)[:, 0]
    assert problem.approach.margins(places).values.min() > 0.0


def _velocity_of_chaser(drawn: Drawn[Witness]) -> np.ndarray:
    """Return how fast the chaser's frame begins in the frame that the witness was drawn in."""
    given, witness = drawn.problem, drawn.witness
    body = given.target_body
    assert body is not None
    there = in_own_frame(given)
    assert there.target_body is not None
    relative = there.start.linear_velocity_chaser_in_inertial - there.target_body.linear_velocity
    return np.asarray(relative + witness.body.linear_velocity)


@pytest.mark.ci
def test_the_class_has_all_robots_passing_spheres_and_both_weights_of_the_duration(
    times: Callable[[int, int], int],
) -> None:
    drawn = [all_features.problem(number).problem for number in range(times(5, 8))]
    assert len({one.robot.joints for one in drawn}) == 3
    assert {one.objective.duration for one in drawn} == {0.0, 0.05}
    passing = [s for one in drawn for s in one.obstacles if s.is_sphere and s.body is None]
    assert len(passing) >= 0.75 * len(drawn)
    fast = [np.linalg.norm(one.start.linear_velocity_chaser_in_inertial) for one in drawn]
    assert min(fast) > 100.0
    assert min(np.linalg.norm(one.start.position_chaser_in_inertial) for one in drawn) > 1e5


@pytest.mark.parametrize("number", [3, pytest.param(9, marks=pytest.mark.nightly)])
def test_a_plan_is_found_and_sound(number: int) -> None:
    problem = all_features.problem(number).problem
    made = perform(PlanningTask(problem, SETTINGS))
    assert made.duration is not None
    # In orbit the samples have too few digits to judge them by.
    frame = system_frame(problem.robot, problem.start)
    require_sound(frame.problem(lasting(problem, made.duration)), frame.plan(made), SETTINGS)
