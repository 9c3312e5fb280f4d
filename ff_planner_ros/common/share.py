"""Where the files of ROS packages lie, found with and without ROS installed."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from ff_planner_ros.errors import FfPlannerError, InvalidInput, Status

PACKAGE = "ff_planner_ros"
PACKAGE_SCHEME = "package://"
# Below a prefix: packages that msg_defs builds where they are not installed.
STAND_INS = "share/ff_planner_msgs/stand_ins"


def share_directory() -> Path:
    """Return the directory of this package's `config`: the source tree, or where it is installed.

    Raises:
        FfPlannerError: The package was copied here without its configuration.
    """
    source_tree = Path(__file__).resolve().parents[2]
    if (source_tree / "package.xml").is_file():
        return source_tree
    installed = _installed_share_directory(PACKAGE)
    if installed is None:
        raise FfPlannerError(
            Status.INTERNAL_ERROR,
            f"the configuration of {PACKAGE} is not installed: no share/{PACKAGE} below "
            f"{_prefix_list()}",
        )
    return installed


def resolve_uri(uri: str, relative_to: Path | None, field: str = "robot.urdf") -> Path:
    """Return the absolute path of the robot description that a URI names.

    Args:
        uri: `package://PACKAGE/PATH`, or a path; `~` is the home directory.
        relative_to: Directory that a relative path starts from; None: what names it comes from
            elsewhere, and no file of this machine is read.
        field: Field that holds the URI, for errors.

    Raises:
        InvalidInput: There is no such package or no such file, or no file is read.
    """
    if relative_to is None:
        raise _refused(field, uri, "what comes from elsewhere names no file of this machine")
    if uri.startswith(PACKAGE_SCHEME):
        path = _path_in_package(uri, field)
    else:
        try:
            path = (relative_to / Path(uri).expanduser()).resolve()
        except (RuntimeError, ValueError) as error:  # no such user; a character no path can have
            raise _refused(field, uri, f"it is no path: {error}") from None
    if not path.is_file():
        raise _refused(field, uri, f"there is no file {path}")
    return path


def installation_prefixes() -> list[Path]:
    """List the prefixes that packages are installed below, in the order of search.

    The sourced workspaces come first, then the environment of this Python: pip installs into it,
    and the ament path does not hold it. Last come packages that stand in for missing ones.
    """
    sourced = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    prefixes = [Path(prefix) for prefix in (*sourced, sys.prefix) if prefix]
    return [*prefixes, *filter(Path.is_dir, (prefix / STAND_INS for prefix in prefixes))]


def package_directory(package: str) -> Path | None:
    """Return the share directory of a ROS package; None: there is no such package."""
    return share_directory() if package == PACKAGE else _installed_share_directory(package)


def _path_in_package(uri: str, field: str) -> Path:
    package, _, path = uri.removeprefix(PACKAGE_SCHEME).partition("/")
    if not package or not path:
        raise _refused(field, uri, f"it must read {PACKAGE_SCHEME}PACKAGE/PATH")
    share = package_directory(package)
    if share is None:
        raise _refused(field, uri, f"there is no package {package} below {_prefix_list()}")
    return share / path


def _installed_share_directory(package: str) -> Path | None:
    """Look a package up in the ament index, by its files: that needs no ROS to be installed."""
    for prefix in installation_prefixes():
        if (prefix / "share/ament_index/resource_index/packages" / package).is_file():
            return prefix / "share" / package
    return None


def _prefix_list() -> str:
    return ", ".join(map(str, installation_prefixes()))


def _refused(field: str, uri: str, reason: str) -> InvalidInput:
    return InvalidInput(Status.BAD_ROBOT, field, uri, reason)
