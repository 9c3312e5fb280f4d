"""Messages of packages that no wheel has: of the real definition, and never over a real package."""

from __future__ import annotations

import importlib.metadata
import os
import subprocess
import sys
from pathlib import Path

import pytest

from ff_planner_ros.bag.mcap.definition import message_definition
from ff_planner_ros.common.share import STAND_INS
from ff_planner_ros.ros.messages.foreign import (
    FollowJointTrajectory,
    JointTrajectoryControllerState,
    TFMessage,
)

# As `ros2 topic info --verbose /tf` says on every Jazzy machine.
TF_HASH = "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"
PACKAGES = ("control_msgs", "tf2_msgs")


def test_transforms_are_of_the_type_that_every_other_node_has() -> None:
    assert message_definition("tf2_msgs/msg/TFMessage").hash == TF_HASH
    assert TFMessage.get_fields_and_field_types() == {
        "transforms": "sequence<geometry_msgs/TransformStamped>"
    }


def test_the_action_has_the_fields_of_jazzys_controllers_in_their_order() -> None:
    """Without names on the wire, their order and types are all that counts."""
    tolerances = {
        f"{part}{when}_tolerance": f"sequence<control_msgs/{kind}>"
        for when in ("path", "goal")
        for part, kind in (("", "JointTolerance"), ("component_", "JointComponentTolerance"))
    }
    goal = FollowJointTrajectory.Goal.get_fields_and_field_types()
    assert list(goal.items()) == [
        ("trajectory", "trajectory_msgs/JointTrajectory"),
        ("multi_dof_trajectory", "trajectory_msgs/MultiDOFJointTrajectory"),
        *tolerances.items(),
        ("goal_time_tolerance", "builtin_interfaces/Duration"),
    ]
    result = FollowJointTrajectory.Result.get_fields_and_field_types()
    assert list(result.items()) == [("error_code", "int32"), ("error_string", "string")]
    states = [f"{of}{what}" for of in ("", "multi_dof_") for what in ("desired", "actual", "error")]
    feedback = list(FollowJointTrajectory.Feedback.get_fields_and_field_types())
    assert feedback == ["header", "joint_names", *states[:3], "multi_dof_joint_names", *states[3:]]


def test_the_state_has_the_fields_of_jazzys_controllers_in_their_order() -> None:
    points = ("reference", "feedback", "error", "output")
    point = "trajectory_msgs/JointTrajectoryPoint"
    multi = "trajectory_msgs/MultiDOFJointTrajectoryPoint"
    assert list(JointTrajectoryControllerState.get_fields_and_field_types().items()) == [
        ("header", "std_msgs/Header"),
        ("joint_names", "sequence<string>"),
        *((name, point) for name in points),
        ("multi_dof_joint_names", "sequence<string>"),
        *((f"multi_dof_{name}", multi) for name in points),
        ("speed_scaling_factor", "double"),
    ]


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_that_stands_in_lies_where_no_real_one_is_installed(package: str) -> None:
    installed = importlib.metadata.distribution("ff_planner_msgs").files or []
    of_package = [Path(str(file)) for file in installed if package in Path(str(file)).parts]
    for file in of_package:
        assert STAND_INS in file.as_posix(), file


def test_a_real_package_goes_first(tmp_path: Path) -> None:
    """It is imported instead, and no path of the process changes for it."""
    for package, part, *names in (
        ("tf2_msgs", "msg", "TFMessage"),
        ("control_msgs", "msg", "JointTolerance", "JointTrajectoryControllerState"),
        ("control_msgs", "action", "FollowJointTrajectory"),
    ):
        (tmp_path / package).mkdir(exist_ok=True)
        (tmp_path / package / "__init__.py").touch()
        classes = "".join(f"class {name}: pass\n" for name in names)
        (tmp_path / package / f"{part}.py").write_text(classes)
    asked = (
        "import sys; before = list(sys.path)\n"
        "from ff_planner_ros.ros.messages.foreign import TFMessage, FollowJointTrajectory\n"
        "assert before == sys.path\n"
        "print(sys.modules['tf2_msgs'].__file__, sys.modules['control_msgs'].__file__)"
    )
    path = os.pathsep.join(filter(None, (str(tmp_path), os.environ.get("PYTHONPATH"))))
    found = subprocess.run(
        [sys.executable, "-c", asked],
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=True,
    )
    assert found.stdout.split() == [str(tmp_path / one / "__init__.py") for one in PACKAGES[::-1]]
