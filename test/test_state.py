"""Snapshots of the system."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.state import SystemState

VALUES: dict[str, Any] = {
    "position_chaser_in_inertial": [1.0, 2.0, 3.0],
    "quaternion_chaser_to_inertial_xyzw": [0.0, 0.6, 0.0, 0.8],
    "linear_velocity_chaser_in_inertial": [0.1, 0.2, 0.3],
    "angular_velocity_chaser_in_inertial": [0.4, 0.5, 0.6],
    "joint_positions": [1.1, 1.2, 1.3, 1.4, 1.5, 1.6],
    "joint_velocities": [0.01, 0.02, 0.03, 0.04, 0.05, 0.06],
    "joint_accelerations": [0.1, -0.2, 0.3, -0.4, 0.5, -0.6],
}
# As a user of scenario files and messages knows them.
PUBLIC_NAMES = {
    "position_chaser_in_inertial": "chaser.position",
    "quaternion_chaser_to_inertial_xyzw": "chaser.quaternion_xyzw",
    "linear_velocity_chaser_in_inertial": "chaser.linear_velocity",
    "angular_velocity_chaser_in_inertial": "chaser.angular_velocity",
    "joint_positions": "joints.position",
    "joint_velocities": "joints.velocity",
    "joint_accelerations": "joints.acceleration",
}


def refusal_of(**changed: object) -> InvalidInput:
    """The error that a state with these values raises."""
    with pytest.raises(InvalidInput) as refusal:
        SystemState(**{**VALUES, **changed})
    return refusal.value


def test_a_state_holds_what_it_was_given() -> None:
    state = SystemState(**VALUES)
    for name, value in VALUES.items():
        np.testing.assert_allclose(getattr(state, name), value, rtol=1e-15)


@pytest.mark.parametrize("name", VALUES)
def test_a_state_without_finite_entries_is_refused(name: str) -> None:
    for bad in (np.nan, np.inf, -np.inf):
        error = refusal_of(**{name: [bad, *VALUES[name][1:]]})
        assert (error.status, error.field) == (Status.NOT_FINITE, PUBLIC_NAMES[name])


@pytest.mark.parametrize("name", [name for name in VALUES if name != "joint_positions"])
def test_a_value_of_the_wrong_size_is_refused(name: str) -> None:
    for bad in (VALUES[name][1:], [*VALUES[name], 0.0], [VALUES[name]]):
        error = refusal_of(**{name: bad})
        assert (error.status, error.field) == (Status.WRONG_SIZE, PUBLIC_NAMES[name])


@pytest.mark.parametrize("bad", [[0.0, 0.0, 0.0, 0.0], [0.0, 0.6, 0.0, 0.81], [1.0, 1.0, 1.0, 1.0]])
def test_a_quaternion_that_is_not_of_unit_length_is_refused(bad: list[float]) -> None:
    error = refusal_of(quaternion_chaser_to_inertial_xyzw=bad)
    assert (error.status, error.field) == (Status.BAD_QUATERNION, "chaser.quaternion_xyzw")


def test_a_quaternion_off_by_rounding_is_brought_to_unit_length() -> None:
    rounded = [0.0, 0.6001, 0.0, 0.8]
    state = SystemState(**{**VALUES, "quaternion_chaser_to_inertial_xyzw": rounded})
    quaternion = state.quaternion_chaser_to_inertial_xyzw
    assert abs(np.linalg.norm(quaternion) - 1.0) < 1e-15
    np.testing.assert_allclose(quaternion, rounded / np.linalg.norm(rounded), rtol=1e-15)


@pytest.mark.parametrize("name", VALUES)
def test_a_state_neither_follows_its_source_nor_can_be_written_to(name: str) -> None:
    source = np.array(VALUES[name])
    state = SystemState(**{**VALUES, name: source})
    source[:] = 0.0
    np.testing.assert_allclose(getattr(state, name), VALUES[name], rtol=1e-15)
    with pytest.raises(ValueError, match="read-only"):
        getattr(state, name)[0] = 0.0
