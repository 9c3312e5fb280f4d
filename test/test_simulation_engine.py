"""MuJoCo and Pinocchio read the same URDF, each by its own code, and must mean the same system."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from robots import ROBOTS, random_state

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.robot.momentum import total_momentum
from ff_planner_ros.simulation.engine import Engine


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(4)


def rates(engine: Engine, state: Array, torques: Array) -> tuple[Array, Array]:
    """Return the rates of change of position and velocity."""
    position_rate, velocity_rate = np.split(engine.derivative(state, torques), [engine.model.nq])
    return position_rate, velocity_rate


def pinocchio_q(state: Array, engine: Engine) -> Array:
    """Pinocchio writes quaternions with w last."""
    q = state[: engine.model.nq].copy()
    q[3:7] = np.roll(q[3:7], -1)
    return q


def test_mass_centre_of_mass_and_mass_matrix_are_pinocchios(
    robot: Robot, rng: np.random.Generator
) -> None:
    engine, data = Engine(robot), robot.model.createData()
    for _ in range(5):
        state = engine.state(random_state(robot, rng))
        q = pinocchio_q(state, engine)
        engine_data = mujoco.MjData(engine.model)
        engine_data.qpos = state[: engine.model.nq]
        mujoco.mj_forward(engine.model, engine_data)
        total = pin.computeTotalMass(robot.model)
        assert engine.model.body_subtreemass[0] == pytest.approx(total, rel=1e-14)
        assert engine_data.subtree_com[0] == pytest.approx(
            pin.centerOfMass(robot.model, data, q), abs=1e-12
        )
        found = np.zeros((engine.model.nv, engine.model.nv))
        mujoco.mj_fullM(engine.model, engine_data, found)
        wanted = np.triu(pin.crba(robot.model, data, q))
        wanted += np.triu(wanted, 1).T
        # MuJoCo's base moves along inertial axes, Pinocchio's along its own.
        to_engine = np.eye(engine.model.nv)
        to_engine[:3, :3] = pin.Quaternion(q[3:7]).toRotationMatrix()
        assert to_engine.T @ found @ to_engine == pytest.approx(
            wanted, rel=1e-11, abs=1e-12 * wanted.max()
        )


def test_poses_joints_and_momentum_are_pinocchios(robot: Robot, rng: np.random.Generator) -> None:
    engine, data = Engine(robot), robot.model.createData()
    for _ in range(5):
        start = random_state(robot, rng)
        state = engine.state(start)
        seen = engine.observe(state)
        q, v = configuration(robot, start)
        momentum = total_momentum(robot, data, q, v)
        pin.forwardKinematics(robot.model, data, q)
        tip = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
        tip_rotation = pin.Quaternion(seen.ee_quaternion_xyzw).toRotationMatrix()
        chaser_quaternion = start.quaternion_chaser_to_inertial_xyzw
        assert seen.chaser_position == pytest.approx(start.position_chaser_in_inertial, abs=1e-12)
        assert abs(seen.chaser_quaternion_xyzw @ chaser_quaternion) == pytest.approx(1.0, abs=1e-14)
        assert seen.ee_position == pytest.approx(tip.translation, abs=1e-12)
        assert tip_rotation == pytest.approx(tip.rotation, abs=1e-12)
        assert seen.momentum == pytest.approx(momentum, abs=1e-11 * np.abs(momentum).max())
        for found, wanted in zip(
            engine.joints(state), (start.joint_positions, start.joint_velocities), strict=True
        ):
            assert found.tolist() == wanted.tolist()


def test_accelerations_under_joint_torques_are_pinocchios(
    robot: Robot, rng: np.random.Generator
) -> None:
    engine, data = Engine(robot), robot.model.createData()
    for _ in range(5):
        start, torques = random_state(robot, rng), rng.normal(scale=5.0, size=robot.joints)
        state = engine.state(start)
        q, v = configuration(robot, start)
        acceleration = pin.aba(robot.model, data, q, v, np.concatenate([np.zeros(6), torques]))
        _, found = rates(engine, state, torques)
        assert found[6:] == pytest.approx(
            acceleration[6:], rel=1e-9, abs=1e-9 * np.abs(acceleration).max()
        )


def test_the_rate_of_a_state_is_where_it_goes(robot: Robot, rng: np.random.Generator) -> None:
    engine = Engine(robot)
    state = engine.state(random_state(robot, rng))
    step = 1e-5
    found, _ = rates(engine, state, np.zeros(robot.joints))
    position, velocity = np.split(state, [engine.model.nq])
    ahead, behind = position.copy(), position.copy()
    mujoco.mj_integratePos(engine.model, ahead, velocity, step)
    mujoco.mj_integratePos(engine.model, behind, velocity, -step)
    assert found == pytest.approx((ahead - behind) / (2 * step), abs=1e-8)


def test_nothing_acts_on_the_system_but_what_the_joints_do(rng: np.random.Generator) -> None:
    """Neither gravity nor a URDF's friction nor a joint limit: the accelerations are those without.

    Pinocchio looks at none of them; the start is beyond the limits of every joint.
    """
    urdf, base_link, tip_link = ROBOTS["lemur"]
    sticky = urdf.replace("<limit", '<dynamics damping="5.0" friction="7.0"/><limit')
    sticky = sticky.replace("3.141592653589793", "0.01")
    assert sticky.count("dynamics") == 7
    robot = robot_from_urdf_text(sticky, base_link, tip_link)
    start = random_state(robot_from_urdf_text(urdf, base_link, tip_link), rng)
    engine, data = Engine(robot), robot.model.createData()
    q, v = configuration(robot, start)
    wanted = pin.aba(robot.model, data, q, v, np.zeros(13))
    _, found = rates(engine, engine.state(start), np.zeros(7))
    assert found[6:] == pytest.approx(wanted[6:], rel=1e-9)


def test_a_system_twice_as_heavy_needs_twice_the_torques(
    robot: Robot, rng: np.random.Generator
) -> None:
    light, heavy = Engine(robot), Engine(robot)
    for bodies in (heavy.chaser_bodies, heavy.arm_bodies):
        heavy.scale_inertias(bodies, np.full(len(bodies), 2.0), np.full(len(bodies), 2.0))
    state = light.state(random_state(robot, rng))
    torques = rng.normal(size=robot.joints)
    assert heavy.derivative(state, 2.0 * torques) == pytest.approx(
        light.derivative(state, torques), rel=1e-9, abs=1e-12
    )
    assert heavy.observe(state).momentum == pytest.approx(
        2.0 * light.observe(state).momentum, rel=1e-12
    )


def test_chaser_and_arm_are_scaled_apart(lemur: Robot) -> None:
    engine = Engine(lemur)
    engine.scale_inertias(engine.arm_bodies, np.full(8, 1.1), np.ones(8))
    assert engine.model.body_mass.sum() == pytest.approx(350.0 + 1.1 * 25.9)
    engine.scale_inertias(engine.chaser_bodies, np.full(1, 0.9), np.ones(1))
    assert engine.model.body_mass.sum() == pytest.approx(0.9 * 350.0 + 1.1 * 25.9)


def test_viscous_friction_takes_torque_in_proportion_to_the_rate(
    lemur: Robot, rng: np.random.Generator
) -> None:
    free, rubbing = Engine(lemur), Engine(lemur)
    coefficients = rng.uniform(1.0, 2.0, 7)
    rubbing.add_friction(coefficients, np.zeros(7))
    start, torques = random_state(lemur, rng), rng.normal(size=7)
    state = free.state(start)
    assert rubbing.derivative(state, torques) == pytest.approx(
        free.derivative(state, torques - coefficients * start.joint_velocities), rel=1e-9
    )


def test_dry_friction_holds_a_resting_joint_and_slows_a_moving_one_by_its_torque(
    lemur: Robot, rng: np.random.Generator
) -> None:
    free, rubbing = Engine(lemur), Engine(lemur)
    friction = np.full(7, 0.2)
    rubbing.add_friction(np.zeros(7), friction)
    at_rest = np.concatenate([[0, 0, 0, 1, 0, 0, 0], rng.uniform(-1.0, 1.0, 7), np.zeros(13)])
    torques = rng.uniform(-0.1, 0.1, 7)
    held, moved = rubbing.derivative(at_rest, torques), free.derivative(at_rest, torques)
    assert np.abs(held[20:]).max() < 0.05 * np.abs(moved[20:]).max()
    moving = at_rest.copy()
    moving[20:] = rng.choice([-1.0, 1.0], 7)  # fast enough to slide
    assert rubbing.derivative(moving, torques) == pytest.approx(
        free.derivative(moving, torques - friction * np.sign(moving[20:])), rel=1e-6, abs=1e-9
    )


def test_a_urdf_that_mujoco_refuses_is_refused_in_its_words() -> None:
    urdf, base_link, tip_link = ROBOTS["lemur"]
    beyond = urdf.replace(
        'ixx="0.0106" iyy="0.0106" izz="0.0045"', 'ixx="0.0106" iyy="0.0106" izz="0.02120001"'
    )
    assert beyond != urdf  # the planner forgives a thin body's rounding, MuJoCo does not
    robot = robot_from_urdf_text(beyond, base_link, tip_link)
    with pytest.raises(InvalidInput, match=r"robot\.urdf.*MuJoCo says.*A \+ B >= C.*'link_1'"):
        Engine(robot)


def test_links_beyond_all_measure_are_taken_without_a_word(
    recwarn: pytest.WarningsRecorder,
) -> None:
    urdf, base_link, tip_link = ROBOTS["lemur"]
    far = urdf.replace('xyz="1.5 ', 'xyz="1e12 ')
    assert far != urdf
    Engine(robot_from_urdf_text(far, base_link, tip_link))
    assert not recwarn.list


def test_without_mujoco_the_message_says_how_to_get_it(tmp_path: Path) -> None:
    code = (
        "import sys; sys.modules['mujoco'] = None\n"
        "from ff_planner_ros.cli import main\n"
        "sys.exit(main(['verify', 'answer.json']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert "needs MuJoCo: pip install 'ff_planner_ros[simulation]'" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("module", ["engine", "contacts", "verification"])
def test_without_mujoco_every_module_says_it_as_an_error_of_ours(module: str) -> None:
    code = (
        "import sys; sys.modules['mujoco'] = None\n"
        "from ff_planner_ros.errors import FfPlannerError\n"
        f"try: import ff_planner_ros.simulation.{module}\n"
        "except FfPlannerError as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "needs MuJoCo: pip install 'ff_planner_ros[simulation]'" in done.stdout, done.stderr


@pytest.mark.parametrize("link", ["root", "bus", "antenna", "link_1", "tool"])
def test_a_link_called_world_is_a_link_like_others(rng: np.random.Generator, link: str) -> None:
    """MuJoCo calls the inertial frame so: what hangs on such a link would be several robots."""
    urdf, base_link, tip_link = ROBOTS["six joints"]
    given = urdf.replace('"bus"/><child link="antenna"', '"root"/><child link="antenna"')
    plain = robot_from_urdf_text(given, base_link, tip_link)
    ends = ["world" if end == link else end for end in (base_link, tip_link)]
    renamed = given.replace(f'"{link}"', '"world"').replace('"camera"', '"world_"')
    robot = robot_from_urdf_text(renamed, *ends)
    start = random_state(robot, rng)
    seen, expected = (one.observe(one.state(start)) for one in (Engine(robot), Engine(plain)))
    for found, same in zip(seen, expected, strict=True):
        assert found == pytest.approx(same, abs=1e-12 * max(1.0, np.abs(same).max()))
    q, v = configuration(robot, start)
    momentum = total_momentum(robot, robot.model.createData(), q, v)
    assert seen.chaser_position == pytest.approx(start.position_chaser_in_inertial, abs=1e-12)
    assert seen.momentum == pytest.approx(momentum, abs=1e-11 * np.abs(momentum).max())
