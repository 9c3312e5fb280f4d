"""A planar base: against a model written out, and executed in an independent engine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from planar_model import (
    TESTBED,
    Body,
    mass_matrix,
    momentum,
    planar_robot,
    planar_state,
    planar_urdf,
    random_bodies,
    turned,
)
from robots import CONFIG

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.motion.forward import carried_forward, driven
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.motion.motion import to_trajectory
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.configuration import configuration, system_state
from ff_planner_ros.robot.dynamics import base_acceleration, inverse_dynamics
from ff_planner_ros.robot.model import Base, load_robot, robot_from_urdf_text
from ff_planner_ros.robot.momentum import base_twist, generalised_jacobian, total_momentum
from ff_planner_ros.simulation.engine import Engine
from ff_planner_ros.simulation.verification import verify

TESTBED_URDF = CONFIG / "robots/planar_testbed/planar_testbed.urdf"
CASES = ["testbed", "two joints", "three joints", "four joints"]


class Case:
    """A robot on a table, the bodies it is made of, and a state."""

    def __init__(self, name: str) -> None:
        rng = np.random.default_rng(CASES.index(name))
        if name == "testbed":
            self.bodies: tuple[Body, ...] = TESTBED
            self.robot = load_robot(
                TESTBED_URDF, "satellite", "end_effector", Base.PLANAR, geometry=Geometry.LINES
            )
        else:
            self.bodies = random_bodies(CASES.index(name) + 1, rng)
            self.robot = planar_robot(self.bodies, rng)
        joints = len(self.bodies) - 1
        self.place, self.heading = rng.uniform(-2.0, 2.0, 2), float(rng.uniform(-3.0, 3.0))
        self.angles = rng.uniform(-2.0, 2.0, joints)
        self.u = rng.uniform(-0.3, 0.3, 3 + joints)
        self.state = planar_state(
            np.append(self.place, self.heading),
            self.u[:3],
            self.angles,
            self.u[3:],
            self.bodies[0],
            z=0.37,
        )
        self.q, self.v = configuration(self.robot, self.state)
        self.data = self.robot.model.createData()
        # From x', y' in inertial axes to those of the base.
        self.to_base = np.eye(3 + joints)
        self.to_base[:2, :2] = turned(self.heading).T
        self.kept = [0, 1, 5, *range(6, 6 + joints)]


@pytest.fixture(params=CASES, scope="module")
def case(request: pytest.FixtureRequest) -> Case:
    """Robots on a table: the testbed, and some with masses above and below the plane."""
    return Case(request.param)


def near(found: Array, expected: Array, tolerance: float = 1e-10) -> None:
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=tolerance * np.abs(expected).max())


def test_its_mass_matrix_is_that_written_out(case: Case) -> None:
    matrix = np.array(pin.crba(case.robot.model, case.data, case.q))[np.ix_(case.kept, case.kept)]
    expected = mass_matrix(case.bodies, np.array([case.heading, *case.angles]))
    near(case.to_base.T @ matrix @ case.to_base, expected)


def test_its_momentum_is_that_written_out(case: Case) -> None:
    found = total_momentum(case.robot, case.data, case.q, case.v)[[0, 1, 5]]
    near(found, momentum(case.bodies, case.place, np.array([case.heading, *case.angles]), case.u))


def test_its_velocity_follows_from_the_momentum_written_out(case: Case) -> None:
    angles = np.array([case.heading, *case.angles])
    planar = momentum(case.bodies, case.place, angles, case.u)
    # What the table takes up has no influence.
    whole = np.array([planar[0], planar[1], 7.0, -8.0, 9.0, planar[2]])
    found = base_twist(case.robot, case.data, case.q, whole, case.u[3:])
    assert not found[[2, 3, 4]].any()
    near(found[[0, 1, 5]], (case.to_base @ case.u)[:3])


def test_its_generalised_jacobian_moves_the_end_effector_at_zero_momentum(case: Case) -> None:
    rates = case.u[3:]
    matrix = mass_matrix(case.bodies, np.array([case.heading, *case.angles]))
    of_base = -np.linalg.solve(matrix[:3, :3], matrix[:3, 3:] @ rates)
    tips = []
    for step in (-1e-5, 1e-5):
        turns = np.cumsum([case.heading + step * of_base[2], *(case.angles + step * rates)])
        place = case.place + step * of_base[:2]
        ends = [turned(a) @ np.array(b.end) for a, b in zip(turns, case.bodies, strict=True)]
        tips.append([*(place + np.sum(ends, axis=0)), turns[-1]])
    expected = np.subtract(tips[1], tips[0]) / 2e-5
    found = generalised_jacobian(case.robot, case.data, case.q)
    assert found.shape == (3, case.robot.joints)
    near(found @ rates, expected, 1e-8)


def test_joint_accelerations_leave_its_momentum_as_it_is(case: Case) -> None:
    """The momentum written out, shortly before and after, in a motion of these accelerations."""
    wanted = np.linspace(-0.5, 0.4, case.robot.joints)
    found = base_acceleration(case.robot, case.data, case.q, case.v, wanted)
    assert not found[[2, 3, 4]].any()
    # A base frame that turns: d(x', y')/dt in inertial axes.
    of_u = np.concatenate([found[[0, 1, 5]], wanted])
    of_u[:2] += case.u[2] * np.array([-case.v[1], case.v[0]])
    of_u = case.to_base.T @ of_u
    momenta = []
    for step in (-1e-4, 1e-4):
        moved = np.array([*case.place, case.heading, *case.angles])
        moved += step * case.u + step**2 / 2 * of_u
        momenta.append(momentum(case.bodies, moved[:2], moved[2:], case.u + step * of_u))
    change = (momenta[1] - momenta[0]) / 2e-4
    scale = np.abs(mass_matrix(case.bodies, np.array([case.heading, *case.angles])) @ of_u).max()
    assert np.abs(change).max() < 1e-7 * scale


def test_the_table_bears_what_leaves_the_plane(case: Case) -> None:
    """Forces of the base in the plane vanish; those that would lift and tilt it are the table's."""
    wanted = np.linspace(-0.5, 0.4, case.robot.joints)
    acceleration = np.concatenate(
        [base_acceleration(case.robot, case.data, case.q, case.v, wanted), wanted]
    )
    wrench = inverse_dynamics(case.robot, case.data, case.q, case.v, acceleration)[:6]
    assert np.abs(wrench[[0, 1, 5]]).max() < 1e-12 * max(1.0, np.abs(wrench).max())


def waving(joints: int, rng: np.random.Generator, seconds: float = 4.0) -> JointMotion:
    """Return a motion of the joints that begins and ends anyhow."""
    time = np.linspace(0.0, seconds, 41)
    size, rate, phase = rng.uniform(0.2, 0.5, joints), rng.uniform(0.5, 1.2, joints), joints
    angle = np.outer(time, rate) + phase
    return JointMotion(
        time, size * np.sin(angle), size * rate * np.cos(angle), -size * rate**2 * np.sin(angle)
    )


@pytest.mark.law("PLAN-16")
def test_a_motion_keeps_height_attitude_and_momentum_written_out(case: Case) -> None:
    rng = np.random.default_rng(5)
    motion = waving(case.robot.joints, rng)
    start = replace(
        case.state, joint_positions=motion.positions[0], joint_velocities=motion.velocities[0]
    )
    q_start, v_start = configuration(case.robot, start)
    whole = total_momentum(case.robot, case.data, q_start, v_start)
    q, v, _ = driven(case.robot, q_start, whole, motion, np.linspace(0.0, 4.0, 161))
    assert (q[:, 2] == q_start[2]).all()
    assert np.abs(q[:, 3:5]).max() < 1e-12
    assert not v[:, 2:5].any()
    for q_i, v_i in zip(q[::20], v[::20], strict=True):
        there = system_state(case.robot, q_i, v_i)
        heading = 2.0 * np.arctan2(*there.quaternion_chaser_to_inertial_xyzw[2:])
        place = q_i[:2]
        u = np.concatenate([turned(heading) @ v_i[:2], v_i[5:]])
        found = momentum(case.bodies, place, np.array([heading, *q_i[7:]]), u)
        np.testing.assert_allclose(found, whole[[0, 1, 5]], rtol=0.0, atol=1e-8)


def test_a_state_carried_forward_stays_on_the_table(case: Case) -> None:
    there = carried_forward(case.robot, case.state, 3.0, None)
    assert there.position_chaser_in_inertial[2] == pytest.approx(0.37, abs=1e-12)
    assert not there.linear_velocity_chaser_in_inertial[2]
    assert not there.angular_velocity_chaser_in_inertial[:2].any()


def test_a_motion_executed_in_mujoco_stays_on_the_table_and_comes_true(case: Case) -> None:
    rng = np.random.default_rng(8)
    motion = waving(case.robot.joints, rng)
    start = replace(
        case.state, joint_positions=motion.positions[0], joint_velocities=motion.velocities[0]
    )
    q_start, v_start = configuration(case.robot, start)
    whole = total_momentum(case.robot, case.data, q_start, v_start)
    q, v, dv = driven(case.robot, q_start, whole, motion, motion.time)
    found = verify(case.robot, to_trajectory(case.robot, motion.time, q, v, dv))
    assert found.passed, found.deviation
    off = found.execution.chaser_positions[:, 2] - 0.37
    assert np.abs(off).max() < 1e-9


def test_without_its_table_the_same_motion_does_not_come_true() -> None:
    """The arm is above the carriage's centre of mass: free, the carriage would tilt."""
    case = Case("three joints")
    motion = waving(3, np.random.default_rng(8))
    start = replace(
        case.state, joint_positions=motion.positions[0], joint_velocities=motion.velocities[0]
    )
    q_start, v_start = configuration(case.robot, start)
    whole = total_momentum(case.robot, case.data, q_start, v_start)
    q, v, dv = driven(case.robot, q_start, whole, motion, motion.time)
    trajectory = to_trajectory(case.robot, motion.time, q, v, dv)
    free = robot_from_urdf_text(case.robot.urdf, "body_0", "tip")
    assert not verify(free, trajectory).passed


@pytest.mark.parametrize("down", [False, True])
def test_an_axis_may_point_down(down: bool) -> None:
    rng = np.random.default_rng(3)
    assert planar_robot(random_bodies(3, rng), rng, down).joints == 3


def tilted(old: str, new: str) -> str:
    rng = np.random.default_rng(3)
    text = planar_urdf(random_bodies(3, rng), rng)
    assert old in text
    return text.replace(old, new, 1)


@pytest.mark.parametrize("axis", ["1 0 0", "0 0.01 1", "0 -1 -1"])
def test_a_joint_axis_out_of_the_plane_is_refused(axis: str) -> None:
    text = tilted('<axis xyz="0 0 1"/>', f'<axis xyz="{axis}"/>')
    with pytest.raises(InvalidInput, match=r"joint 'joint_1' axis.*normal of the table") as refused:
        robot_from_urdf_text(text, "body_0", "tip", Base.PLANAR)
    assert refused.value.status is Status.BAD_ROBOT
    robot_from_urdf_text(text, "body_0", "tip")


def test_a_right_angle_written_with_few_digits_is_one() -> None:
    text = tilted('<axis xyz="0 0 1"/>', '<axis xyz="0 0.0008 1"/>')
    assert robot_from_urdf_text(text, "body_0", "tip", Base.PLANAR).base is Base.PLANAR


def test_a_base_link_that_leans_is_refused() -> None:
    rng = np.random.default_rng(3)
    text = planar_urdf(random_bodies(3, rng), rng).replace(
        '<robot name="on_a_table">',
        '<robot name="on_a_table"><link name="foot"/><joint name="foot" type="fixed">'
        '<parent link="foot"/><child link="body_0"/><origin xyz="0 0 0" rpy="0.3 0 0"/></joint>',
    )
    with pytest.raises(InvalidInput, match="base link's z axis"):
        robot_from_urdf_text(text, "body_0", "tip", Base.PLANAR)


def test_dry_friction_on_a_table_is_that_written_out() -> None:
    """However small: the solver's tolerance must not be measured against the table's inertia."""
    case = Case("testbed")
    friction, rates = 1e-5, np.array([1e-3, -1e-3, 1e-3])
    engine = Engine(case.robot)
    engine.add_friction(np.zeros(3), np.full(3, friction))
    state = engine.state(
        planar_state(np.zeros(3), np.zeros(3), case.angles, rates, case.bodies[0], 0.0)
    )
    found = engine.derivative(state, np.zeros(3))[-3:]
    forces = np.concatenate([np.zeros(3), -friction * np.sign(rates)])
    expected = np.linalg.solve(mass_matrix(case.bodies, np.array([0.0, *case.angles])), forces)
    np.testing.assert_allclose(found, expected[3:], rtol=0.05)
