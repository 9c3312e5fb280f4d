"""The names of the path families, for all that only chooses among them."""

import enum


class Parametrisation(enum.StrEnum):
    """Which motions a plan is looked for among; but for `AUTO` the name of a path family."""

    # The paper's; joint splines where it does not apply, finds no plan, or the attitude counts
    AUTO = "auto"
    END_EFFECTOR_POLYNOMIAL = "end_effector_polynomial"
    JOINT_SPLINE = "joint_spline"
