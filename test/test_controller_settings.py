"""What the parameters of a joint_trajectory_controller mean to plans."""

from __future__ import annotations

from dataclasses import replace

import pytest

from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import load_parameters


@pytest.mark.parametrize("name", ["path_tolerance", "goal_tolerance", "goal_time_tolerance"])
def test_a_tolerance_for_which_the_controller_would_take_none_is_refused(name: str) -> None:
    with pytest.raises(InvalidInput, match=rf"controller\.{name} is -0\.5: .* -1\.0"):
        replace(load_parameters().controller, **{name: -0.5})


def test_with_the_action_no_end_is_refused_for_the_tolerance_is_left_out() -> None:
    parameters = replace(load_parameters().controller, stopped_velocity_tolerance=0.01)
    assert parameters.setup.stopped_velocity_tolerance == 0.01
    handed = replace(parameters, hand_over="action")
    assert handed.setup.stopped_velocity_tolerance == 0.0
