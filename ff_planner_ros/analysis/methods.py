"""The planning methods that are compared, as tables and pictures show them."""

from __future__ import annotations

from dataclasses import dataclass

from ff_planner_ros.planning.problem.problem import Objective


@dataclass(frozen=True)
class Method:
    """A planning method; its name, colour and dash are the same in every table and picture."""

    name: str  # in tables
    colour: str  # one of Okabe and Ito's, which colour-blind readers tell apart
    dash: str  # line style of matplotlib; tells methods apart in grey print too

    @property
    def label(self) -> str:
        """Name in pictures, which have Greek letters."""
        return self.name.replace("Theta", "Θ")


STRAIGHT_LINE = Method("straight line", "#000000", "dotted")
POTENTIAL_FIELD = Method("APF", "#e69f00", "dashdot")
SHORTEST = Method("min(L)", "#0072b2", "solid")
STEADIEST = Method("min(Theta)", "#d55e00", "dashed")
WEIGHTED = Method("L + 50 Theta", "#009e73", "solid")
SOONER = Method("min(L+0.02T)", "#009e73", "dashdot")
SHORTEST_SPLINE = Method("min(L), joint splines", "#0072b2", "dashdot")
STEADIEST_SPLINE = Method("min(Theta), joint splines", "#d55e00", "dashdot")
FIXED_BASE = Method("fixed base", "#cc79a7", "dashdot")
ZERO_MOMENTUM = Method("zero momentum", "#56b4e9", "dashed")

# Those of the paper's figures 3 to 6.
PAPERS_METHODS = (STRAIGHT_LINE, POTENTIAL_FIELD, SHORTEST, STEADIEST)

# What the planner minimises, by method. With the weights of the last, the paper's capture turns the
# chaser half as far as the shortest plan does, on a joint path twice as long.
OBJECTIVES = {
    SHORTEST: Objective(joint_path_length=1.0, chaser_attitude=0.0),
    STEADIEST: Objective(joint_path_length=0.0, chaser_attitude=1.0),
    WEIGHTED: Objective(joint_path_length=1.0, chaser_attitude=50.0),
    SHORTEST_SPLINE: Objective(joint_path_length=1.0, chaser_attitude=0.0),
    STEADIEST_SPLINE: Objective(joint_path_length=0.0, chaser_attitude=1.0),
}
# Whose paths are joint splines; those of the planner's other plans are the paper's.
SPLINES = (SHORTEST_SPLINE, STEADIEST_SPLINE)

# Of one plan: the prediction, the measurement, and the difference.
PLANNED = Method("planned", "#0072b2", "solid")
MEASURED = Method("measured", "#d55e00", "dashed")
DEVIATION = Method("deviation", "#d55e00", "solid")
