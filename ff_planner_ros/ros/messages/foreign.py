"""Messages that no ROS wheel contains: those of the ROS installation, or else of msg_defs."""

from __future__ import annotations

import ctypes
import sys
from importlib.util import find_spec
from typing import TYPE_CHECKING

from ff_planner_ros.common.share import STAND_INS, installation_prefixes


def provide(*packages: str) -> None:
    """Make packages of messages importable, from their stand-ins if they are not installed.

    Nothing changes for packages that are installed. A package without a stand-in raises Python's
    ImportError when it is imported.
    """
    missing = [package for package in packages if find_spec(package) is None]
    for prefix in installation_prefixes():
        for package in missing if prefix.match(STAND_INS) else ():
            # The middleware looks them up by name, and no path of the process leads here.
            for library in sorted((prefix / "lib").glob(f"lib{package}__*.so")):
                ctypes.CDLL(str(library))
            for found in (prefix / "lib").glob(f"python3*/site-packages/{package}"):
                sys.path.append(str(found.parent))


if not TYPE_CHECKING:
    provide("control_msgs", "tf2_msgs")

from control_msgs.action import FollowJointTrajectory  # noqa: E402
from control_msgs.msg import JointTolerance, JointTrajectoryControllerState  # noqa: E402
from tf2_msgs.msg import TFMessage  # noqa: E402

__all__ = [
    "FollowJointTrajectory",
    "JointTolerance",
    "JointTrajectoryControllerState",
    "TFMessage",
]
