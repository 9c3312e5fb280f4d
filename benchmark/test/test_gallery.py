"""The problems that others published: their motions on our models give their numbers."""

import re

import numpy as np
import pinocchio as pin
import pytest

from ff_planner_benchmark.gallery import recomputed
from ff_planner_benchmark.gallery.compared import Compared
from ff_planner_benchmark.gallery.motions import by_law, by_torques, driven, ee_pose, quintic
from ff_planner_benchmark.gallery.recomputed import COMPARISONS, as_printed, model
from ff_planner_ros.robot.model import Base

MODELS = sorted(recomputed.HERE.glob("models/*.urdf"))
PLANAR = {"cbk_planar", "space_robot_rl", "spart_planar"}
ROOTS = {"cbk_planar": "satellite", "basilisk_arm": "hub"}


def loaded(name):
    base = Base.PLANAR if name in PLANAR else Base.FREE_FLYER
    return model(name, base, ROOTS.get(name, "base"))


SLOW = {"P5"}
BY_PROBLEM = [pytest.param(one, marks=[pytest.mark.ci] * (one in SLOW)) for one in COMPARISONS]


@pytest.mark.sampled
@pytest.mark.parametrize("problem", BY_PROBLEM)
def test_their_motion_on_our_model_gives_their_digits(problem):
    quick = {"quick": True} if problem == "P5" else {}
    for one in COMPARISONS[problem](**quick):
        assert one.agrees, f"{one.what}: {one.printed} {one.unit} published, {one.ours:.8f} ours"


@pytest.mark.nightly
def test_the_laws_on_the_circle_give_their_digits_in_their_steps():
    for one in recomputed.compliance_circles():
        assert one.agrees, f"{one.what}: {one.printed} {one.unit} published, {one.ours:.8f} ours"


def test_a_number_agrees_if_it_rounds_to_the_printed_digits():
    assert Compared("turn", "deg", "6.88", 6.8764).agrees
    assert not Compared("turn", "deg", "6.88", 6.8749).agrees
    assert not Compared("turn", "deg", "6.880", 6.8764).agrees
    assert Compared("turn", "deg", "-0.005", -0.007, within=2.0).agrees


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_every_model_is_a_robot_and_says_units_frame_and_source(path):
    head = path.read_text().partition("-->")[0]
    for word in ("Source: ", "Units: m, kg, kg m2, rad", "Base frame: "):
        assert word in head
    robot = loaded(path.stem)
    assert pin.computeTotalMass(robot.model) > 40.0


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_momentum_stays_zero_where_torques_drive_the_joints(path):
    robot = loaded(path.stem)
    start = np.clip(0.3, robot.lower_position_limits, robot.upper_position_limits)
    moved = by_torques(
        robot, start, lambda t, _q, _v: 0.01 * np.cos(np.arange(robot.joints) + t), 1.0, 0.01
    )
    center = [pin.centerOfMass(robot.model, robot.model.createData(), q) for q in moved.q[[0, -1]]]
    assert center[1] == pytest.approx(center[0], abs=1e-8)


def test_a_motion_from_torques_is_that_of_its_joints():
    """Forward dynamics and the conservation of momentum give the same base."""
    robot = loaded("spart_3dof")
    torque = np.array([0.02, -0.05, 0.03])
    moved = by_torques(robot, np.full(3, 0.4), lambda *_: torque, 2.0, 0.01)
    time, joints = moved.time, moved.q[:, 7:]
    rates = np.gradient(joints, time, axis=0, edge_order=2)
    led = by_law(
        robot,
        joints[0],
        lambda t, _q: np.array([np.interp(t, time, one) for one in rates.T]),
        2.0,
        0.001,
    )
    assert led.turn == pytest.approx(moved.turn, rel=2e-3)


def test_only_impossible_inertias_are_changed_and_the_file_says_so():
    for path in MODELS:
        robot, text = loaded(path.stem), path.read_text()
        changed = re.findall(r'<link name="link_(\d)">\s*<!-- as printed', text)
        assert bool(changed) == ("Rule for an impossible inertia" in text)
        if not changed:
            continue
        printed = as_printed(path.stem)
        for number in range(1, robot.joints + 1):
            ours, theirs = (one.model.inertias[number + 1].inertia for one in (robot, printed))
            moments = np.linalg.eigvalsh(np.array(theirs))
            possible = moments.sum() >= 2 * moments[-1] and moments[0] > 0.0
            assert possible == np.allclose(ours, theirs, rtol=1e-6)
            assert possible == (str(number) not in changed)
            mended = np.linalg.eigvalsh(np.array(ours))
            assert mended.sum() >= 2 * mended[-1]


def test_the_largest_turn_of_a_motion_is_at_least_its_last():
    robot = loaded("deos")
    moved = driven(robot, quintic(np.zeros(7), np.full(7, 0.5), 10.0), 50)
    assert moved.peak >= abs(moved.turn) > 1.0
    tip = ee_pose(robot, moved.q[-1]).translation
    assert moved.ee().translation.tolist() == tip.tolist()
