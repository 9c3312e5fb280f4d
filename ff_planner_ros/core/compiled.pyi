"""What compiled.cpp offers. Arrays of a wrong shape or that hold NaN are refused by ValueError."""

from ff_planner_ros.arrays import Array

class Chain:
    """A chaser with one arm of joints that turn, 64 at most."""

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
    """Return v of Eqs. (27) and (31) and its derivatives; None in a dynamic singularity.

    Args:
        q: Configuration. Shape (7 + joints,).
        momentum: Total P and L about the inertial origin, inertial axes. Shape (6,).
        twist_ee_in_inertial: Wanted linear and angular velocity. Shape (6,).
        bias: Joint rates z, the nearest to which is wanted. Shape (joints,) [rad/s].
        damping: Singular values of the generalised Jacobian that are not much greater are damped:
            the joint rates stay bounded and the end effector lags behind. Zero for Eq. (31) itself.

    Returns:
        v, shape (6 + joints,), and its derivatives by q in the tangent space, by the twist and by
        the bias, each of shape (6 + joints, columns).
    """
