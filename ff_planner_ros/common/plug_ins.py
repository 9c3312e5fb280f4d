"""Plug-ins of other distributions, by the names of their entry points."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ff_planner_ros.errors import InvalidInput, Status

if TYPE_CHECKING:
    from importlib.metadata import EntryPoints


def names_in_group(group: str) -> list[str]:
    """Return the names of a group's entry points, of whatever distribution, in order."""
    return sorted(_entry_points(group).names)


def plug_in(group: str, name: str, field: str) -> Any:
    """Load the object behind an entry point.

    Args:
        group: Group of entry points.
        field: Field that holds the name, for errors.

    Raises:
        InvalidInput: There is no entry point of this name, or it cannot be imported.
    """
    for one in _entry_points(group):
        if one.name == name:
            try:
                return one.load()
            except Exception as error:  # whatever a module of others does when it is imported
                allowed = f"its entry point cannot be loaded: {type(error).__name__}: {error}"
                raise InvalidInput(Status.UNSUPPORTED, field, one.value, allowed) from error
    names = ", ".join(names_in_group(group)) or "none"
    allowed = f"no installed distribution has it; entry points of {group}: {names}"
    raise InvalidInput(Status.UNSUPPORTED, field, "unknown", allowed)


def _entry_points(group: str) -> EntryPoints:
    from importlib.metadata import entry_points  # loads what reads mail, and most plans need none

    return entry_points(group=group)
