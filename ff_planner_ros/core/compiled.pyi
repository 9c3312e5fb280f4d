"""What compiled.cpp offers. Arrays of a wrong shape or that hold NaN are refused by ValueError."""

from collections.abc import Sequence

from ff_planner_ros.arrays import Array, Indices

MAX_JOINTS: int

class Chain:
    """A chaser with one arm of 1 to `MAX_JOINTS` joints that turn."""

    def __init__(
        self,
        translations: Array,  # of joints and end effector in the joint before; (joints + 1, 3)
        rotations: Array,  # likewise; shape (joints + 1, 3, 3)
        axes: Array,  # unit vectors in the joints' frames; shape (joints, 3)
        masses: Array,  # of base and links; shape (joints + 1,)
        centers: Array,  # of mass, in the frames of their joints; shape (joints + 1, 3)
        inertias: Array,  # about the centres of mass; shape (joints + 1, 3, 3)
    ) -> None: ...
    @property
    def joints(self) -> int: ...

def velocity(
    chain: Chain,
    q: Array,
    momentum: Array,
    twist_ee_in_inertial: Array,
    bias: Array,
    damping: float,
) -> tuple[Array, Array, Array, Array] | None:
    """Return what `core.velocity_map.Velocity` holds; None in a dynamic singularity."""

def end_effector_motion(
    chain: Chain,
    q_start: Array,
    momentum: Array,
    duration: float,
    quintic: Array,
    rotation_outer: Array,
    null_space: Array,
    fading: float,
    x: Array,
    points: int,
    damping: float,
) -> float | tuple[Array, Array, Array, Array, Array, Array, Array]:
    """Integrate the motion that follows from a polynomial path of the end effector.

    Args:
        q_start: Configuration at the first point. Shape (7 + joints,).
        momentum: Constant total P and L about the inertial origin. Shape (6,).
        duration: Of the motion [s].
        quintic: As in `EndEffectorPolynomial`, like the next. Shape (6, 6).
        rotation_outer: Shape (3, 3).
        null_space: Rates and accelerations of `NullSpaceFade`. Shape (2, joints).
        fading: Until they have faded [s].
        x: Coefficients of the free terms, flattened. Shape (18,).

    Returns:
        The time of a dynamic singularity [s], or q, v and q half-way; their derivatives, with a
        column a coefficient; dv/dt. Shapes as in `Motion` and `Sensitivity`.
    """

def end_effector_twist(
    duration: float, quintic: Array, rotation_outer: Array, x: Array, s: Array
) -> tuple[Array, Array, Array]:
    """Return twists, accelerations and d twist / dx of the path at normalised times s.

    Returns:
        Inertial axes. Shapes (times, 6), (times, 6) and (times, 6, 18).
    """

def arm_points_with_derivatives(
    chain: Chain, q: Array, q_sensitivity: Array
) -> tuple[Array, Array]:
    """Return what the function of this name in `planning.clearance` does."""

def clearances(
    chain: Chain,
    q: Array,
    q_sensitivity: Array,
    times: Array,
    centers: Array,
    velocities: Array,
    radii: Array,
    interest: float,
    quarter_way: bool,
) -> tuple[Array, Array, Indices]:
    """Return what `planning.clearance.clearance_rows` does.

    Args:
        centers: Of the spheres when the plan begins. Shape (spheres, 3).
        velocities: Shape (spheres, 3).
        radii: Shape (spheres,).
    """

def smallest_singular_values(
    chain: Chain, joints: Array, rows: Sequence[int]
) -> tuple[Array, Array]:
    """Return those of the generalised Jacobian, Eq. (32), and their derivatives by the joints.

    Args:
        joints: Positions. Shape (points, joints).
        rows: `Base.rows`.

    Returns:
        Shapes (points,) and (points, joints).
    """
