"""What of a robot is kept clear, for all that only chooses."""

import enum


class Geometry(enum.StrEnum):
    """What of the robot is collision-checked."""

    SHAPES = "shapes"  # links, chaser, panels and tool as the URDF's <collision> has them
    LINES = "lines"  # the paper's: the arm's centre lines, nothing else
