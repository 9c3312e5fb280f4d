"""What a table lets pass of a state, and what it refuses: to both sides, and upside down."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.plane import (
    MAX_SPEED_OFF_PLANE,
    MAX_TILT,
    flattened,
    in_plane,
    on_the_table,
)
from ff_planner_ros.robot.state import SystemState

SIDES = pytest.mark.parametrize("side", [1.0, -1.0])
UPSIDE_DOWN = Rotation.from_euler("x", np.pi)


def state(turn: Rotation, linear: Array, angular: Array) -> SystemState:
    return SystemState(
        position_chaser_in_inertial=np.array([1.0, 2.0, 0.3]),
        quaternion_chaser_to_inertial_xyzw=turn.as_quat(),
        linear_velocity_chaser_in_inertial=linear,
        angular_velocity_chaser_in_inertial=angular,
        joint_positions=np.array([0.1, -0.2]),
        joint_velocities=np.array([0.3, -0.4]),
    )


@SIDES
@pytest.mark.parametrize("down", [False, True])
@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("heading", [0.0, 2.5, -2.5])
def test_a_tilt_is_taken_away_and_told(heading: float, axis: str, down: bool, side: float) -> None:
    """The nearest attitude with z up or down has the same heading, and is as far as the tilt."""
    flat = Rotation.from_euler("z", heading) * (UPSIDE_DOWN if down else Rotation.identity())
    tilted = flat * Rotation.from_euler(axis, side * 0.3)
    found, tilt = flattened(tilted.as_quat())
    assert tilt == pytest.approx(0.3, abs=1e-12)
    assert (flat.inv() * Rotation.from_quat(found)).magnitude() < 1e-12
    assert np.linalg.norm(found) == pytest.approx(1.0, abs=1e-15)


@SIDES
@pytest.mark.parametrize("axis", ["x", "y"])
def test_a_chaser_that_leans_is_refused_and_one_that_nearly_stands_is_put_upright(
    axis: str, side: float
) -> None:
    heading, still = Rotation.from_euler("z", 1.2), np.zeros(3)
    nearly = heading * Rotation.from_euler(axis, 0.95 * side * MAX_TILT)
    upright = Rotation.from_quat(
        on_the_table(state(nearly, still, still)).quaternion_chaser_to_inertial_xyzw
    )
    assert (heading.inv() * upright).magnitude() < 1e-12
    leaning = heading * Rotation.from_euler(axis, 1.05 * side * MAX_TILT)
    with pytest.raises(InvalidInput, match=r"chaser\.quaternion_xyzw is .* 1\.2 degrees off") as no:
        on_the_table(state(leaning, still, still))
    assert no.value.status is Status.OUT_OF_RANGE


@SIDES
@pytest.mark.parametrize(
    ("name", "entry"),
    [("linear_velocity", 2), ("angular_velocity", 0), ("angular_velocity", 1)],
)
def test_a_speed_off_the_plane_is_refused_and_a_small_one_left_out(
    name: str, entry: int, side: float
) -> None:
    velocities = {"linear_velocity": np.array([0.5, -0.6, 0.0]), "angular_velocity": np.zeros(3)}
    velocities["angular_velocity"][2] = -0.7
    off = velocities[name]
    off[entry] = 0.95 * side * MAX_SPEED_OFF_PLANE
    given = state(Rotation.identity(), *velocities.values())
    kept = on_the_table(given)
    assert kept.linear_velocity_chaser_in_inertial.tolist() == [0.5, -0.6, 0.0]
    assert kept.angular_velocity_chaser_in_inertial.tolist() == [0.0, 0.0, -0.7]
    assert kept.joint_velocities.tolist() == [0.3, -0.4]
    off[entry] = 1.05 * side * MAX_SPEED_OFF_PLANE
    field = f"{name}_chaser_in_inertial"
    with pytest.raises(InvalidInput, match=rf"chaser\.{name} is .* it leaves the plane") as no:
        on_the_table(replace(given, **{field: off}))
    assert no.value.status is Status.OUT_OF_RANGE


def test_what_leaves_the_plane_in_two_ways_at_once_counts_as_one() -> None:
    """One to either side does not make up for the other."""
    off = 0.9 * MAX_SPEED_OFF_PLANE * np.array([1.0, -1.0, 0.0])
    with pytest.raises(InvalidInput, match="about x and y it must be zero"):
        in_plane("chaser.angular_velocity", off, [0, 1], "rad/s")
    kept = in_plane("chaser.angular_velocity", off / 2.0, [0, 1], "rad/s")
    assert kept.tolist() == [0.0, 0.0, 0.0]
