"""Systems as they may be: each error by itself, against formulas written out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from robots import CONFIG

from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.planning.problem.uncertainty import (
    Uncertainty,
    directions,
    draws,
    uncertainty_from,
)
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.robot.model import Robot

RUNS, SEED = range(6), 4
ASIDE = np.array([0.3, -0.2, 0.5])  # the chaser's centre of mass, from the base's origin [m]
NONE = {"mass": 0.0, "inertia": 0.0, "angular_velocity": 0.0}


@pytest.fixture(scope="module")
def planar() -> Robot:
    return load_scenario(CONFIG / "scenarios/planar_capture.yaml").robot


def test_the_base_moves_with_a_chaser_whose_velocities_are_wrong(lemur: Robot) -> None:
    """The chaser's velocity is that of its centre of mass, about which the base's origin turns."""
    lemur = replace(lemur, position_chaser_in_base=ASIDE)
    asked = Uncertainty(**NONE | {"linear_velocity": 0.3, "angular_velocity": 0.2})
    found = draws(lemur, asked, RUNS, SEED)
    for errors, twist in zip(found.errors[:, -6:], found.base_twist, strict=True):
        velocity, turn = 0.3 * errors[:3], 0.2 * errors[3:]
        np.testing.assert_allclose(twist[:3], velocity + np.cross(turn, -ASIDE), atol=1e-12)
        np.testing.assert_allclose(twist[3:], turn, atol=1e-12)
    linear = directions(lemur, asked).base_twist
    np.testing.assert_allclose(found.errors @ linear.T, found.base_twist, atol=1e-12)


def test_a_table_bears_what_would_lift_or_tilt_the_chaser(planar: Robot) -> None:
    asked = Uncertainty(**NONE | {"linear_velocity": 0.3, "angular_velocity": 0.2})
    planar = replace(planar, position_chaser_in_base=ASIDE)
    found = draws(planar, asked, RUNS, SEED)
    assert np.abs(found.base_twist[:, [2, 3, 4]]).max() == 0.0
    for errors, twist in zip(found.errors[:, -6:], found.base_twist, strict=True):
        turn = np.array([0.0, 0.0, 0.2 * errors[5]])
        wanted = 0.3 * errors[:2] + np.cross(turn, -ASIDE)[:2]
        np.testing.assert_allclose(twist[:2], wanted, atol=1e-12)
        assert twist[5] == pytest.approx(turn[2])


@pytest.mark.parametrize("name", ["mass", "inertia", "center_of_mass"])
def test_each_body_is_denser_larger_or_elsewhere_by_its_own_error(lemur: Robot, name: str) -> None:
    """As Pinocchio has the parameters of a body of that mass, centre and inertia."""
    asked = Uncertainty(**NONE | {name: 0.05})
    found = draws(lemur, asked, RUNS, SEED)
    bodies = list(lemur.model.inertias)[1:]
    for run, errors in enumerate(found.errors[:, :-6].reshape(len(RUNS), len(bodies), 5)):
        for index, (body, own) in enumerate(zip(bodies, errors, strict=True)):
            heavier = np.exp(0.05 * own[0]) if name == "mass" else 1.0
            larger = np.exp(0.05 * own[1]) if name == "inertia" else 1.0
            moved = 0.05 * own[2:] if name == "center_of_mass" else np.zeros(3)
            there = pin.Inertia(
                body.mass * heavier, np.array(body.lever) + moved, np.array(body.inertia) * larger
            )
            told = found.parameters[run, 10 * index : 10 * (index + 1)]
            np.testing.assert_allclose(told, there.toDynamicParameters(), rtol=1e-10, atol=1e-12)
            assert found.masses[run, index] == pytest.approx(heavier)
            assert found.inertias[run, index] == pytest.approx(larger)


@pytest.mark.parametrize("name", ["mass", "inertia", "center_of_mass"])
def test_directions_are_what_small_errors_do(lemur: Robot, name: str) -> None:
    asked = Uncertainty(**NONE | {name: 1e-6})
    found = draws(lemur, asked, RUNS, SEED)
    nothing = draws(lemur, Uncertainty(**NONE), RUNS, SEED)
    changes = found.parameters - nothing.parameters
    linear = found.errors @ directions(lemur, asked).parameters.T
    np.testing.assert_allclose(linear, changes, atol=2e-8, rtol=1e-4)
    assert np.abs(changes).max() > 1e-6


def test_rates_and_friction_deviate_by_what_was_asked_for_and_friction_never_pushes(
    lemur: Robot,
) -> None:
    many, seeds = range(2000), 9
    found = draws(lemur, Uncertainty(joint_velocity=0.25, friction=0.5), many, seeds)
    assert found.joint_rates.std() == pytest.approx(0.25, rel=0.05)
    assert found.joint_rates.min() < 0.0 < found.joint_rates.max()
    assert found.friction.min() >= 0.0
    assert np.sqrt((found.friction**2).mean()) == pytest.approx(0.5, rel=0.05)
    still = draws(lemur, Uncertainty(), many, seeds)
    assert not still.joint_rates.any()
    assert not still.friction.any()


@pytest.mark.parametrize("value", [-1e-9, 1.1, np.nan, np.inf])
@pytest.mark.parametrize("name", ["mass", "center_of_mass", "friction"])
def test_a_deviation_that_is_none_is_refused_by_the_name_it_was_given(
    name: str, value: float
) -> None:
    with pytest.raises(InvalidInput, match=rf"planner\.robust\.{name}"):
        uncertainty_from("planner.robust", {name: value})
    assert getattr(uncertainty_from("planner.robust", {name: 0.125}), name) == 0.125
    assert uncertainty_from("planner.robust", {}) == Uncertainty()
