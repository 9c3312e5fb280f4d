"""Other engines than MuJoCo in which plans are executed: plug-ins of other distributions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from ff_planner_ros.common.plug_ins import names_in_group, plug_in
from ff_planner_ros.errors import FfPlannerError, InvalidInput
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.simulation.deviation import Deviation, is_allowed

ENGINES = "ff_planner_ros.engines"  # group of entry points


@dataclass(frozen=True)
class Flown:
    """The result of executing a plan open loop in another engine."""

    engine: str  # name and version
    deviation: Deviation  # from the plan
    pair: str  # nearest at the plan's points: "body/body" or "body/obstacle"; empty: there is none
    time: float  # when it is nearest, from the start of the plan [s]
    distance: float  # then; negative where they penetrate, infinite without a pair [m]

    @property
    def passed(self) -> bool:
        """Whether the plan was reproduced without a contact."""
        return is_allowed(self.deviation) and self.distance > 0.0


# Executes a plan in a scene, in a number of parts that each begin on the plan, as `verify` does.
# Pairs that the scene allows to touch at the goal are not measured. An FfPlannerError says that the
# engine cannot execute it.
Engine: TypeAlias = Callable[[Robot, Trajectory, Scene, int], Flown]


def other_engines(asked: Sequence[str] = ()) -> tuple[Sequence[Engine], Sequence[str]]:
    """Return the engines that are asked for, or else all that are installed, and notes on others.

    An engine that lacks packages of its own is not installed; one that is broken makes a note.

    Args:
        asked: Names of entry points; empty: all.

    Raises:
        InvalidInput: An engine that is asked for is not there, or cannot be loaded.
    """
    if asked:
        return [plug_in(ENGINES, name, f"--engine {name}") for name in asked], ()
    engines, notes = list[Engine](), list[str]()
    for name in names_in_group(ENGINES):
        try:
            engines.append(plug_in(ENGINES, name, f"engine {name}"))
        except InvalidInput as error:
            if not isinstance(error.__cause__, ModuleNotFoundError | FfPlannerError):
                notes.append(str(error))
    return engines, notes
