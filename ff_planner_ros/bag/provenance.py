"""Provenance of a bag: versions of packages, host and time."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import subprocess
from datetime import UTC, datetime
from pathlib import Path

import pinocchio

from ff_planner_ros.planning.scenario.scenario import FORMAT

# The metadata record of MCAP that holds it.
PROVENANCE = "ff_planner_ros"
# Names of distributions, of wheels and of ROS packages.
_DISTRIBUTIONS = {
    "ff_planner_ros": ("ff_planner_ros",),
    "ff_planner_msgs": ("ff_planner_msgs",),
    "numpy": ("numpy",),
    "scipy": ("scipy",),
    "mcap": ("mcap",),
    "rclpy": ("ros-jazzy-rclpy", "rclpy"),
}
_GIT_PATIENCE = 5.0  # [s]


def versions() -> dict[str, str]:
    """Return what a plan depends on beside its task: versions by package, machine and format.

    `git` is there only if the package runs from a checkout.
    """
    description = _git_description(Path(__file__).resolve().parents[2])
    return {
        **{name: _version(names) for name, names in _DISTRIBUTIONS.items()},
        # Where ROS installs it, it is no Python distribution.
        "pin": str(pinocchio.__version__),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "scenario_format": str(FORMAT),
    } | ({"git": description} if description else {})


def provenance(**more: str) -> dict[str, str]:
    """Return the provenance of this process: `versions`, host, distribution, start, and `more`."""
    return {
        **versions(),
        "host": platform.node(),
        "ros_distro": os.environ.get("ROS_DISTRO", "jazzy"),
        "started": datetime.now(UTC).isoformat(timespec="milliseconds"),
        **more,
    }


def _version(names: tuple[str, ...]) -> str:
    for name in names:
        try:
            return importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            pass
    return "unknown"


def _git_description(directory: Path) -> str:
    """Return what git calls the state of a checkout; empty if the directory is not its top."""
    if not (directory / ".git").exists():
        return ""
    command = ["git", "-C", str(directory), "describe", "--always", "--tags", "--dirty"]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=_GIT_PATIENCE, check=False
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip()
