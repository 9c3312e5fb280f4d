"""Inertias that no body has: refused, counted as written, or replaced by the nearest possible."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from robots import LEMUR_URDF
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation
from test_target_urdf import URDF, scenario_with_urdf
from test_tumbling import body_of

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.scenario.robot_file import RobotFile
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.robot.collision.urdf_body import urdf_body
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.robot.urdf.payload import Payload, with_payload
from ff_planner_ros.robot.urdf.urdf_bodies import nearest_possible
from ff_planner_ros.robot.urdf.urdf_faults import InertiaChoice
from ff_planner_ros.simulation.engine import Engine

LEMUR = LEMUR_URDF.read_text()
# As ETS-VII's first links have it, and as a link of TECSAS
BEYOND_THE_TRIANGLE = 'ixx="0.01" iyy="0.02" izz="0.09" ixy="0.001" ixz="0" iyz="0.002"'
NONE = 'ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"'
NEGATIVE = 'ixx="-0.02" iyy="0.03" izz="0.01" ixy="0" ixz="0.001" iyz="0"'
AS_GIVEN, NEAREST = InertiaChoice.AS_GIVEN, InertiaChoice.NEAREST


def with_inertia(link: str, inertia: str, text: str = LEMUR) -> str:
    pattern = rf'(<link name="{link}">.*?<inertia )[^>]*(/>)'
    changed, count = re.subn(pattern, rf"\g<1>{inertia}\2", text, count=1, flags=re.DOTALL)
    assert count == 1
    return changed


def robot_of(text: str, choice: InertiaChoice = InertiaChoice.POSSIBLE) -> Robot:
    return robot_from_urdf_text(text, "chaser", "end_effector", inertia=choice)


def moments_of(robot: Robot, joint: str) -> Array:
    return np.linalg.eigvalsh(robot.model.inertias[robot.model.getJointId(joint)].inertia)


def second_moments(inertia: Array) -> Array:
    return np.linalg.eigvalsh(np.trace(inertia) / 2.0 * np.eye(3) - inertia)


@pytest.mark.sampled
@pytest.mark.parametrize("seed", range(30))
def test_the_nearest_possible_inertia_is_the_nearest(seed: int) -> None:
    """Against a search over all densities: S = L L^T is any that has no negative moments."""
    rng = np.random.default_rng(seed)
    axes = Rotation.random(random_state=rng).as_matrix()
    given = axes @ np.diag(rng.normal(0.3, 1.0, 3) * 10.0 ** rng.integers(-3, 4)) @ axes.T
    found = nearest_possible(given)
    size = np.abs(given).max()
    assert second_moments(found).min() > 0.0
    assert second_moments(found).min() > -1e-15 * size

    def miss(factor: Array) -> float:
        lower = np.zeros((3, 3))
        lower[np.tril_indices(3)] = factor
        density = lower @ lower.T
        return float(np.sum((np.trace(density) * np.eye(3) - density - given / size) ** 2))

    tries = [minimize(miss, rng.normal(size=6), tol=1e-14).fun for _ in range(8)]
    assert np.linalg.norm(found - given) / size == pytest.approx(np.sqrt(min(tries)), abs=2e-5)


def test_a_possible_inertia_is_its_own_nearest() -> None:
    for moments in ([1.0, 2.0, 2.5], [0.1, 3.0, 3.05]):
        given = np.diag(moments)
        np.testing.assert_allclose(nearest_possible(given), given, rtol=0, atol=1e-15)


@pytest.mark.parametrize("inertia", [BEYOND_THE_TRIANGLE, NONE, NEGATIVE])
def test_by_default_an_impossible_inertia_is_refused_by_name_and_amount(inertia: str) -> None:
    text = with_inertia("link_3", inertia)
    with pytest.raises(InvalidInput, match=r"link 'link_3' inertia is of principal moments .*\("):
        robot_of(text)
    with pytest.raises(InvalidInput):
        robot_of(text, InertiaChoice.POSSIBLE)


def test_as_given_counts_what_is_written_and_notes_it() -> None:
    robot = robot_of(with_inertia("link_3", BEYOND_THE_TRIANGLE), AS_GIVEN)
    written = np.array([[0.01, 0.001, 0], [0.001, 0.02, 0.002], [0, 0.002, 0.09]])
    np.testing.assert_allclose(
        moments_of(robot, "joint_3"), np.linalg.eigvalsh(written), rtol=1e-12
    )
    (note,) = robot.notes
    assert note.startswith("link 'link_3' inertia is of principal moments 0.00")
    assert note.endswith("which no body has: it counts as written")
    data, q = robot.model.createData(), pin.neutral(robot.model)
    assert np.linalg.eigvalsh(pin.crba(robot.model, data, q)).min() > 0.0


def test_an_inertia_as_given_moves_in_mujoco_as_in_pinocchio() -> None:
    """Its compiler would refuse it. The link's inertia is in axes of its own."""
    text = with_inertia("link_3", BEYOND_THE_TRIANGLE)
    turned = re.sub(
        r'(<link name="link_3">.*?<origin [^>]*?)(/>\s*<mass)',
        r'\1 rpy="0.4 -0.3 1.1"\2',
        text.replace(' rpy="0.0 0.0 0.0"', ""),
        count=1,
        flags=re.DOTALL,
    )
    assert turned.count("0.4 -0.3 1.1") == 1
    robot = robot_of(turned, AS_GIVEN)
    rng = np.random.default_rng(3)
    state = SystemState(
        rng.normal(size=3),
        Rotation.random(random_state=rng).as_quat(),
        *rng.normal(size=(2, 3)),
        *rng.normal(size=(2, 7)),
    )
    data, (q, v) = robot.model.createData(), configuration(robot, state)
    pin.computeCentroidalMomentum(robot.model, data, q, v)
    center = pin.centerOfMass(robot.model, data, q)
    engine = Engine(robot)
    seen = engine.observe(engine.state(state)).momentum
    linear, angular = data.hg.linear, data.hg.angular + np.cross(center, data.hg.linear)
    np.testing.assert_allclose(seen, [*linear, *angular], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("inertia", [NONE, NEGATIVE])
def test_as_given_refuses_what_the_equations_of_motion_do_not_bear(inertia: str) -> None:
    with pytest.raises(InvalidInput, match=r"'link_3' inertia is .* all three must be positive"):
        robot_of(with_inertia("link_3", inertia), AS_GIVEN)


@pytest.mark.parametrize("inertia", [BEYOND_THE_TRIANGLE, NONE, NEGATIVE])
def test_the_nearest_possible_one_counts_with_a_note_on_how_far_it_is(inertia: str) -> None:
    robot = robot_of(with_inertia("link_3", inertia), NEAREST)
    smallest, middle, largest = moments_of(robot, "joint_3")
    assert smallest > 0.0
    assert largest <= (smallest + middle) * (1.0 + 1e-9)
    (note,) = robot.notes
    assert note.startswith("link 'link_3' inertia is of principal moments ")
    entries = dict(re.findall(r'(i..)="(.*?)"', inertia))
    given = np.array([[float(entries["i" + "".join(sorted(a + b))]) for b in "xyz"] for a in "xyz"])
    away = np.linalg.norm(nearest_possible(given) - given)
    assert f"which is {away:.3g} kg m2 away" in note
    others = robot_of(LEMUR)
    for joint in ("joint_2", "joint_4"):
        assert moments_of(robot, joint).tolist() == moments_of(others, joint).tolist()


def test_a_link_without_mass_stays_refused() -> None:
    massless = re.sub(r'(<link name="link_3">.*?<mass value=")[^"]*', r"\g<1>0", LEMUR, flags=re.S)
    for choice in InertiaChoice:
        with pytest.raises(InvalidInput, match=r"link 'link_3' mass is 0"):
            robot_of(massless, choice)


@pytest.mark.parametrize("choice", [AS_GIVEN, NEAREST])
def test_the_recorded_urdf_is_that_robot_without_the_choice(choice: InertiaChoice) -> None:
    """As bags, plans and campaigns hold it."""
    robot = robot_of(with_inertia("link_3", BEYOND_THE_TRIANGLE), choice)
    for recorded in (robot.urdf, robot.drawn_urdf):
        again = robot_of(recorded)
        assert again.urdf == robot.urdf
        assert again.model == robot.model


def test_a_payload_of_a_robot_is_taken_like_its_links() -> None:
    thin = Payload("link_7", 2.0, np.diag([0.1, 0.1, 0.5]))
    with pytest.raises(InvalidInput, match=r"robot.payload.inertia is of principal moments"):
        with_payload(robot_of(LEMUR), thin)
    held = with_payload(robot_of(LEMUR, NEAREST), thin)
    assert any(note.startswith("link 'payload' inertia is") for note in held.notes)
    with_payload(robot_of(LEMUR, AS_GIVEN), thin)


@pytest.mark.parametrize("choice", [AS_GIVEN, NEAREST])
def test_a_target_body_of_a_urdf_is_taken_alike(choice: InertiaChoice) -> None:
    text = with_inertia("link_3", BEYOND_THE_TRIANGLE)
    with pytest.raises(InvalidInput, match=r"it link 'link_3' inertia is of principal moments"):
        urdf_body(text, "it")
    body, plain = urdf_body(text, "it", inertia=choice), urdf_body(LEMUR, "it")
    assert any("link 'link_3' inertia is of principal" in note for note in body.notes)
    assert body.mass == pytest.approx(plain.mass, rel=1e-12)
    assert second_moments(body.inertia).min() > 0.0


def test_a_scenario_says_it_of_its_target_body(tmp_path: Path) -> None:
    path = scenario_with_urdf(tmp_path)
    careless = URDF.replace('izz="7"', 'izz="9"')
    assert careless != URDF
    (tmp_path / "client/client.urdf").write_text(careless, encoding="utf-8")
    with pytest.raises(InvalidInput, match=r"link 'panel' inertia is of principal moments 1, 6, 9"):
        load_scenario(path)
    scenario_with_urdf(tmp_path, inertia="nearest_possible")
    (tmp_path / "client/client.urdf").write_text(careless, encoding="utf-8")
    problem = load_scenario(path)
    (note,) = (one for one in body_of(problem).notes if "panel" in one and "inertia" in one)
    assert "the nearest possible one counts, 1.66667, 6.66667, 8.33333, which is 1.15 kg" in note
    scenario_with_urdf(tmp_path, inertia="nearest")
    with pytest.raises(InvalidInput, match=r"target_body\.inertia .*it must be possible, as_given"):
        load_scenario(path)


def test_a_scenario_and_a_parameter_say_it_of_the_robot(tmp_path: Path) -> None:
    text = with_inertia("link_3", BEYOND_THE_TRIANGLE)
    (tmp_path / "arm.urdf").write_text(text, encoding="utf-8")
    files = RobotFile("arm.urdf", "chaser", "end_effector", inertia=NEAREST)
    expected = robot_of(text, NEAREST)
    assert files.load(tmp_path).urdf == expected.urdf
    parameters = load_parameters().robot
    assert parameters.inertia == "possible"
    assert replace(parameters, inertia="nearest_possible").load(text).urdf == expected.urdf
    with pytest.raises(InvalidInput, match=r"link 'link_3' inertia"):
        parameters.load(text)
