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

class Start:
    """Where a system begins, and what stays of that."""

    def __init__(
        self,
        position: Array,  # of the base; shape (3,) [m]
        rotation: Array,  # base to inertial axes; shape (3, 3)
        center: Array,  # of mass; shape (3,) [m]
        momentum: Array,  # total P, and L about the centre of mass; shape (6,)
        planar: bool,  # the base moves in the plane of x and y and turns about z
    ) -> None: ...

class Target:
    """What the end effector shall do at the end of a motion, in the inertial frame."""

    def __init__(
        self,
        position: Array,  # shape (3,) [m]
        rotation: Array,  # shape (3, 3)
        twist: Array,  # linear part first; shape (6,)
        acceleration: Array,  # classical; shape (6,)
        orientation: str,  # fixed, about_axis or free
        free_axis: Array,  # in axes of the end effector; shape (3,)
        across: Array,  # axes of the end effector across that one; shape (2, 3)
    ) -> None: ...

class DrivenMotion:
    """The motion of a system whose joints are driven and that nothing pushes."""

    q: Array  # configurations; shape (points, 7 + joints)
    v: Array  # tangent velocities; shape (points, 6 + joints)
    q_half_way: Array  # configurations half-way between the points; shape (points - 1, 7 + joints)

    def __init__(
        self,
        chain: Chain,
        start: Start,
        angles: Array,  # at the points and half-way between; shape (half steps, joints)
        rates: Array,  # likewise
        accelerations: Array,  # likewise
        duration: float,
    ) -> None: ...
    def goal_error(self, target: Target) -> Array:
        """Return what the motion misses of a goal. Shape (rows,)."""

    def sensitivity(
        self, angle_rows: Array, rate_rows: Array, acceleration_row: Array, target: Target
    ) -> tuple[Array, Array, Array, Array, Array]:
        """Return the derivatives of q, v, q half-way and the goal error by x, and dv/dt.

        Args:
            angle_rows: Derivatives of the angles of any joint, at half steps, by the variables of
                that joint. Shape (half steps, variables of a joint).
            rate_rows: Likewise.
            acceleration_row: Likewise, at the end. Shape (variables of a joint,).
        """
