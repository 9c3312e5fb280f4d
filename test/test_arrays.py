"""What crosses between rooms is checked, copied and read-only."""

import math
from array import array

import numpy as np
import pytest

from ff_planner_ros.common.arrays import finite_number, finite_vector, frozen, unit_quaternion
from ff_planner_ros.errors import InvalidInput, Status


def test_a_frozen_array_is_a_copy_that_cannot_be_written():
    values = np.zeros(3)
    array = frozen(values)
    values[0] = 1.0
    assert array[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        array[0] = 2.0


@pytest.mark.parametrize(
    ("values", "status"),
    [
        ([1.0, 2.0], Status.WRONG_SIZE),
        ([[1.0, 2.0, 3.0]], Status.WRONG_SIZE),
        (["a", "b", "c"], Status.WRONG_SIZE),
        ([[1.0], [2.0, 3.0], []], Status.WRONG_SIZE),
        (None, Status.WRONG_SIZE),
        (["1", "2", "3"], Status.WRONG_SIZE),
        (["1", True, 2.0], Status.WRONG_SIZE),
        ([True, 1.0, 2.0], Status.WRONG_SIZE),
        ((1.0, 2.0, np.bool_(False)), Status.WRONG_SIZE),
        (np.array([True, False, True]), Status.WRONG_SIZE),
        (np.array(["1", "2", "3"]), Status.WRONG_SIZE),
        (np.array([1.0, "2", True], object), Status.WRONG_SIZE),
        ([10**400, 0, 0], Status.WRONG_SIZE),
        ([np.nan, 0.0, 0.0], Status.NOT_FINITE),
        ([0.0, -np.inf, 0.0], Status.NOT_FINITE),
    ],
)
def test_what_is_not_three_finite_numbers_is_refused_by_field(values, status):
    with pytest.raises(InvalidInput, match=r"^chaser\.position is ") as refusal:
        finite_vector("chaser.position", values, 3)
    assert refusal.value.status is status


@pytest.mark.parametrize("value", ["1", True, np.bool_(True), b"1"])
def test_text_and_truth_values_are_no_numbers(value):
    with pytest.raises(InvalidInput, match=r"^duration is "):
        finite_number("duration", value)
    for rows in (value, [[1.0, 2.0], [3.0, value]]):
        with pytest.raises(TypeError, match="no numbers"):
            frozen(rows)


def test_the_numbers_of_a_message_are_told_as_a_list():
    refusal = InvalidInput(Status.NOT_FINITE, "positions", array("d", [1.0, math.nan]), "finite")
    assert str(refusal) == "positions is [1.0, nan]: finite"
    long = InvalidInput(Status.WRONG_SIZE, "positions", array("d", range(1_000_000)), "shorter")
    assert str(long).endswith(" 11.0, ...]: shorter")


def test_a_bound_is_exclusive_and_named():
    assert finite_number("duration", 1e-9, above=0.0) == 1e-9
    with pytest.raises(InvalidInput, match=r"duration is 0\.0: it must be greater than 0"):
        finite_number("duration", 0.0, above=0.0)


def test_a_quaternion_within_tolerance_is_normalised_and_others_are_refused_with_their_norm():
    nearly = unit_quaternion("q", [0.0, 0.0, 0.0, 1.0005])
    assert nearly.tolist() == [0.0, 0.0, 0.0, 1.0]
    with pytest.raises(InvalidInput, match=r"q is .*not 1\.1$") as refusal:
        unit_quaternion("q", [0.0, 0.0, 0.0, 1.1])
    assert refusal.value.status is Status.BAD_QUATERNION
    with pytest.raises(InvalidInput, match=r"not 0$"):
        unit_quaternion("q", np.zeros(4))
