"""The choice of a robot's collision geometry, in a module that is quick to import."""

import enum


class Geometry(enum.StrEnum):
    """The parts of a robot that are collision-checked."""

    SHAPES = "shapes"  # links, chaser, panels and tool as the URDF's <collision> has them
    LINES = "lines"  # the paper's: the arm's centre lines, nothing else
