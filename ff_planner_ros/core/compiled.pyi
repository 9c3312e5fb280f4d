"""What bindings/ offers. Arrays of a wrong shape or that hold NaN are refused by ValueError."""

from collections.abc import Callable, Sequence

from ff_planner_ros.common.arrays import Array, Indices

MAX_JOINTS: int
NAMES_EACH: int  # of rows, that a requirement of a program has room for
SOURCES_DIGEST: str  # SHA-256 of the *.cpp and *.hpp that it was built from, in the order of paths

class Chain:
    """A chaser with one arm of 1 to `MAX_JOINTS` joints that turn or slide."""

    def __init__(
        self,
        translations: Array,  # of joints and end effector in the joint before; (all + 1, 3)
        rotations: Array,  # likewise; shape (all + 1, 3, 3)
        axes: Array,  # unit vectors in the joints' frames, zero if they slide; shape (all, 3)
        slides: Array,  # likewise, zero if they turn; shape (all, 3)
        weights: Array,  # of planned joints in the joint path; shape (joints,) [1 or rad/m]
        masses: Array,  # of base and links; shape (all + 1,)
        centers: Array,  # of mass, in the frames of their joints; shape (all + 1, 3)
        inertias: Array,  # about the centres of mass; shape (all + 1, 3, 3)
        before: Sequence[int],  # as of `robot.tree.Tree`, and so are the next ones
        planned: Sequence[int],
        multipliers: Array,
        offsets: Array,
        tip: int,
    ) -> None: ...
    @property
    def joints(self) -> int: ...  # those that are planned

def velocity(
    chain: Chain,
    q: Array,
    momentum: Array,
    twist_ee_in_inertial: Array,
    bias: Array,
    damping: float,
) -> tuple[Array, Array, Array] | None:
    """Return what `core.velocity_map.Velocity` holds; None in a dynamic singularity."""

class EndEffectorPolynomial:
    """A path of the end effector but for its free terms, as `planning.paths.polynomial` has it."""

    def __init__(
        self,
        duration: float,
        quintic: Array,  # shape (6, 6)
        rotation_outer: Array,  # shape (3, 3)
        quintic_by_duration: Array = ...,  # makes the duration a variable; shape (6, 6), or empty
    ) -> None: ...

class NullSpaceFade:
    """Joint motion of the start that fades, as `planning.paths.start_motion` has it."""

    def __init__(
        self,
        rates: Array,  # shape (joints,)
        accelerations: Array,  # shape (joints,)
        seconds: float,  # until they have faded
    ) -> None: ...

def arm_points_with_derivatives(
    chain: Chain, q: Array, q_sensitivity: Array
) -> tuple[Array, Array]:
    """Return what the function of this name in `planning.clearance` does."""

class CubicMotion:
    """A motion from point to point, by cubics in its tangent space."""

    def __init__(
        self,
        chain: Chain,
        q: Array,  # configurations; shape (points, 7 + joints)
        v: Array,  # tangent velocities; shape (points, 6 + joints)
        times: Array,  # shape (points,) [s]
    ) -> None: ...

def held_momenta(chain: Chain, q: Array, v: Array, accelerations: Array) -> tuple[Array, Array]:
    """Return the angular momenta about the centre of mass of a base that does not turn.

    Args:
        accelerations: Of the joints. Shape (points, joints).

    Returns:
        Momenta, and the torques that keep the base from turning, which are the momenta's rates; in
        base axes. Shapes (points, 3).
    """

class Start:
    """Where a system begins, and what stays of that."""

    def __init__(
        self,
        position: Array,  # of the base; shape (3,) [m]
        rotation: Array,  # base to inertial axes; shape (3, 3)
        center: Array,  # of mass; shape (3,) [m]
        momentum: Array,  # total P, and L about the centre of mass; shape (6,)
        base: str,  # free_flyer, planar or attitude_held
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

    def __init__(
        self,
        chain: Chain,
        start: Start,
        angles: Array,  # at the points and half-way between; shape (half steps, joints)
        rates: Array,  # likewise
        accelerations: Array,  # likewise
        duration: float,
    ) -> None: ...
    @property
    def q(self) -> Array: ...  # configurations; shape (points, 7 + joints)
    @property
    def v(self) -> Array: ...  # tangent velocities; shape (points, 6 + joints)
    @property
    def q_half_way(self) -> Array: ...  # half-way between; shape (points - 1, 7 + joints)
    def goal_error(self, target: Target) -> Array:
        """Return what the motion misses of a goal. Shape (rows,)."""

    def goal_error_by_x(
        self, angle_rows: Array, rate_rows: Array, acceleration_row: Array, target: Target
    ) -> Array:
        """Return the derivatives of the goal error by x. Shape (rows, variables).

        Args:
            angle_rows: Derivatives of the angles of any joint, at half steps, by the variables of
                that joint. Shape (half steps, variables of a joint).
            rate_rows: Likewise.
            acceleration_row: Likewise, at the end. Shape (variables of a joint,).
        """

class Solid:
    """A convex solid in its own frame."""

    def __init__(
        self,
        kind: int,  # `robot.collision.bodies.Kind`
        sizes: Array,  # half edges, or radius and half length; shape (3,) [m]
        vertices: Array,  # of a hull; shape (vertices, 3) [m]
        grown: float,  # how far it is grown to all sides [m]
    ) -> None: ...

class Body:
    """A solid that is fixed to a link, or a line to where the next joint slides."""

    def __init__(
        self,
        link: int,  # number of the chain's body that it is fixed to
        rotation: Array,  # in the frame of that; shape (3, 3)
        position: Array,  # likewise; shape (3,) [m]
        center: Array,  # likewise, of a sphere around it; shape (3,) [m]
        radius: float,  # of that sphere [m]
        solid: Solid,
        slide: Array,  # how a line's end moves with the next joint; zero: rigid; shape (3,)
    ) -> None: ...

class Bodies:
    """The solids of a robot, and which of them must not touch."""

    def __init__(
        self,
        bodies: Sequence[Body],
        pairs: Indices,  # shape (pairs, 2)
    ) -> None: ...

class TumblingBody:
    """A body that turns freely."""

    def __init__(
        self,
        position: Array,  # of the centre of mass when the plan begins; shape (3,) [m]
        velocity: Array,  # shape (3,) [m/s]
        begins: Array,  # of the series; shape (series,) [s]
        series: Array,  # of the quaternion (x, y, z, w); shape (series, orders, 4)
    ) -> None: ...

class Obstacle:
    """A convex solid that rests, moves uniformly and turns steadily, or is fixed to a body."""

    def __init__(
        self,
        solid: Solid,
        center: Array,  # in its frame, of a sphere around it; shape (3,) [m]
        radius: float,  # of that sphere [m]
        rotation: Array,  # to inertial axes, when the plan begins, or to the body's; shape (3, 3)
        position: Array,  # then, or in the body; shape (3,) [m]
        velocity: Array,  # shape (3,) [m/s]
        rate: Array,  # turn rate in inertial axes; shape (3,) [rad/s]
        body: TumblingBody | None,  # that it is fixed to
    ) -> None: ...

class Obstacles:
    """Several of them."""

    def __init__(self, obstacles: Sequence[Obstacle]) -> None: ...

def certified_pairs(
    motion: CubicMotion, bodies: Bodies, chosen: Indices, last: int, gap: float, part: float
) -> float:
    """Return a lower bound of the least distance of pairs of bodies until a last point [m].

    Args:
        chosen: Numbers of the pairs.
        gap: How far it may be below the truth [m], or
        part: by which part of it.
    """

def certified_obstacles(
    motion: CubicMotion,
    bodies: Bodies,
    obstacles: Obstacles,
    chosen: Indices,
    last: int,
    gap: float,
    part: float,
) -> float:
    """Return likewise one of bodies and obstacles; chosen: body times obstacles, plus obstacle."""

class WorkingSet:
    """What a step keeps with equality."""

def solve_subproblem(
    at_x: object,
    radius: float,
    penalty: float,
    inside: float,
    guess: WorkingSet | None,
) -> tuple[Array, float, float, Array, Array, Array, float, WorkingSet, bool]:
    """Return the fields of `planning.optimisation.qp.Step` at a `Linearisation`.

    Args:
        inside: How far inside the constraints the step aims [unit of g].
    """

def minimise(
    linearise: Callable[[Array], object],
    start: Array,
    at_start: object,
    curvature: Array,
    radius: float,
    iterations: int,
    tolerance: float,
    progress: float,
    tolerated: float,
    feasibility: float,
    inside: float,
) -> tuple[Array, object, Array, float, int, str, bool, float]:
    """Return where `planning.optimisation.solver.minimise` ends, for functions that it is told.

    Those at x are a `Linearisation`.

    Args:
        feasibility: A constraint that is violated by less counts as kept.
        inside: How far inside the constraints steps aim [unit of g].

    Returns:
        x, the functions there, SR1 curvature, radius, iterations, a word for why it stopped,
        whether it has converged, and first-order optimality; NaN: unknown.
    """

class PathsOnGrid:
    """The paths of one family on one time grid."""

    def motion(self, x: Array) -> float | tuple[Array, Array, Array, Array]:
        """Return the time of a dynamic singularity [s], or q, v, q half-way and the goal error."""

def end_effector_paths(
    chain: Chain,
    q_start: Array,
    momentum: Array,
    path: EndEffectorPolynomial,
    null_space: NullSpaceFade,
    points: int,
    damping: float,
    goal_by_duration: Array = ...,
) -> PathsOnGrid:
    """Return the motions that follow from polynomial paths of the end effector.

    Args:
        q_start: Configuration at the first point. Shape (7 + joints,).
        momentum: Constant total P and L about the inertial origin. Shape (6,).
        goal_by_duration: How the goal's pose changes with the duration, if that is one more
            variable, as of `path`; empty: it is given. Shape (6,) [m/s, rad/s].
    """

class SplineRows:
    """Values of all joints that are linear in the variables of their splines."""

    def __init__(
        self,
        free: Array,  # by the variables of one joint; shape (rows, variables of a joint)
        known: Array,  # what start and goal give; shape (rows, joints)
        # How `known` changes with the duration at fixed parts of it; empty: it is given
        moved: Array = ...,
    ) -> None: ...

def joint_splines(
    chain: Chain,
    start: Start,
    target: Target,
    has_goal: bool,
    duration: float,
    positions: SplineRows,
    rates: SplineRows,
    accelerations: SplineRows,
    position_hull: SplineRows,
    rate_hull: SplineRows,
    target_by_duration: Array = ...,
) -> PathsOnGrid:
    """Return joint splines, whose base follows by conservation of momentum.

    Args:
        has_goal: Whether the target is a condition; otherwise the splines end where they must.
        positions: At half steps; rates and accelerations likewise.
        position_hull: Points whose range bounds each joint.
        rate_hull: Likewise its rate.
        target_by_duration: Place, twist and acceleration, if the duration is one more variable, as
            of all rows; empty: it is given. Shape (3, 6).
    """

class Wheels:
    """Wheels that hold the chaser's attitude."""

    def __init__(
        self,
        shares: Array,  # of each wheel in what the base's axes hold; shape (wheels, 3)
        stored: Array,  # at the start; shape (wheels,) [N m s]
    ) -> None: ...

class PathObjective:
    """The objectives of `planning.optimisation.objectives`."""

    def __init__(
        self,
        joint_path: float,  # weight
        slow: float,  # rate of one more joint, that rounds the kink where all stop [rad/s]
        smoothing: float,  # weight of smooth rates in the joint path
        shares: Array,  # of velocities in the joint path; shape (6 + joints,), or empty: all are 1
        attitude: float,  # weight
        rotation_chaser_to_base: Array,  # shape (3, 3)
        attitude_norm: float,  # p of the p-norm that stands for the largest angle; zero: none does
        wheel_momentum: float = ...,  # weight; where it counts, the attitude does not
        wheels: Wheels | None = ...,
    ) -> None: ...

class ContactsAtStart:
    """Pairs that touch at the start, and may until the end effector has left its place there."""

    def __init__(
        self,
        pairs: Indices,  # by their numbers; they may touch near the goal, too
        places: Array,  # of the end effector as if it had not moved; shape (configurations, 3) [m]
        seen_from_base: bool,  # whether the places are in the base frame, not in the inertial one
    ) -> None: ...

class AllowedContacts:
    """Contacts of bodies that are allowed, as `planning.distance.allowed_contact` says when."""

    def __init__(
        self,
        pairs: Indices,  # by their numbers; near the goal only
        goal: Array,  # its place; shape (configurations, 3), or (0, 3): it has none [m]
        distance: float,  # within which a place is near [m]
        at_start: Sequence[ContactsAtStart],
    ) -> None: ...

class PathRequirement:
    """What makes rows g(x) >= 0 of a path, as the `rows` of a requirement do."""

def positions_within(
    lower: Array,
    upper: Array,
    excess: float,
    margin: float,
    interest: float,
    stop_interest: float,
    jerk: float,
) -> PathRequirement:
    """Return what makes the rows of `JointPositions`.

    Args:
        excess: Of a start that raises a limit [rad, m].
        margin: How far from the limits the search stays [rad, m].
        interest: Rows that are further from violated than this are left out [rad, m].
        stop_interest: Likewise of where joints come to rest after the last point.
        jerk: By which they stop [rad/s3, m/s3].
    """

def rates_within(limits: Array, excess: float, margin: float, interest: float) -> PathRequirement:
    """Return what makes the rows of `JointRates`; excess, margin and interest: parts of limits."""

def attitude_within(
    rotation_chaser_to_base: Array, limit: float, interest: float
) -> PathRequirement:
    """Return what makes the rows of `ChaserAttitude` [rad]."""

def chaser_at_goal(rotation: Array, limit: float, knee: float) -> PathRequirement:
    """Return what makes the rows of `ChaserAtGoal`; rotation: of the base's axes, wanted [rad]."""

def rotation_within(limit: float, knee: float, interest: float) -> PathRequirement:
    """Return what makes the rows of `ChaserRotation`; knee: of Huber's function [rad]."""

def singular_value_above(rows: Sequence[int], margin: float, interest: float) -> PathRequirement:
    """Return what makes the rows of `SingularValues`.

    Args:
        rows: Of the base's twist in which it gives way.
        interest: Multiple of the margin above which values have no rows.
    """

def accelerations_within(
    parts: Array, margin: float, interest: float, between: bool
) -> PathRequirement:
    """Return what makes the rows of `JointAccelerations`; margin and interest: parts of limits.

    Args:
        parts: Of its limit, that a unit is of each joint; zero: it has none. Shape (joints,).
        between: Whether what is between points counts; then they are as dense as the plan's.
    """

def torques_within(base: str, parts: Array, margin: float, interest: float) -> PathRequirement:
    """Return what makes the rows of `Torques`; as of `accelerations_within`."""

def grasp_wrench_within(
    base: str,
    link: int,
    position: Array,
    rotation: Array,
    mass: float,
    center: Array,
    inertia: Array,
    parts: Array,
    margin: float,
    interest: float,
) -> PathRequirement:
    """Return what makes the rows of `GraspWrench`; margin and interest: parts of limits.

    Args:
        link: Number of the chain's body that holds the payload.
        position: Of the grasp's frame in that of this body; rotation likewise.
        mass: Of the payload [kg].
        center: Of its mass, in the grasp's frame [m].
        inertia: About that, likewise [kg m2].
        parts: Of their limits, that a unit of force and of torque is [1/N, 1/(N m)]; zero: none.
    """

def wheels_within(
    wheels: Wheels,
    momenta: Array,
    torques: Array,
    excess: float,
    margin: float,
    interest: float,
    between: bool,
) -> PathRequirement:
    """Return what makes the rows of `WheelLimits`; excess, margin, interest: parts of limits.

    Args:
        momenta: Part of its limit that 1 N m s is, of each wheel; zero: it has none. Torques
            likewise, of 1 N m.
        between: As of `accelerations_within`.
    """

def bodies_clear(
    bodies: Bodies,
    obstacles: Obstacles,
    margin: float,
    room: Array,
    times: Array,
    interest: float,
    quarter_way: bool,
    allowed: AllowedContacts | None,
) -> PathRequirement:
    """Return what makes the rows of bodies and obstacles; pairs are as of `certified_obstacles`.

    Where the room is less than half of the margin, it grows to the margin in a quarter of the
    duration, as the cube of the time, as displacements from rest do: without a margin later on,
    nothing would keep the robot clear between the points.

    Args:
        margin: The largest that distances must keep [m].
        room: What they must keep at most, by the distance at the start. Shape (pairs,) [m].
        times: Of all points but the first, half-way before them, and quarters if they are looked
            at; ascending [s].
        interest: Distances above have no rows [m].
    """

def pairs_apart(
    bodies: Bodies,
    margins: Array,
    interest: float,
    quarter_way: bool,
    allowed: AllowedContacts | None,
) -> PathRequirement:
    """Return what makes the rows of `SelfClearance`; margins: of each pair, shape (pairs,) [m]."""

class GraspSeen:
    """The grasp frame of `planning.distance.grasp_seen`.

    At the times of a path's points but the first, then half-way between the points.
    """

    def __init__(
        self,
        positions: Array,  # inertial frame; shape (times, 3) [m]
        rotations: Array,  # to inertial axes; shape (times, 3, 3)
        counts: Array,  # ones, or zero for the axis along which places do not count; shape (3,)
        twists: Array,  # by the duration T at fixed t / T; shape (times, 6) [m/s, rad/s]
        moves_with_goal: bool,  # whether the goal's own change with T comes on top of these
    ) -> None: ...

def in_corridor(
    grasp: GraspSeen,
    direction: Array,
    distance: float,
    half_angle: float,
    radius: float,
    back_off: float,
    margin: float,
    interest: float,
) -> PathRequirement:
    """Return what makes the rows of `ApproachCorridor`.

    Args:
        direction: Of the approach, unit length, in the grasp frame. Shape (3,).
        radius: Of the corridor at the grasp [m].
        back_off: By how much the corridor is narrower, all along it [m].
        margin: That is kept at the distance; nearer it is less [m].
        interest: Margins above have no rows [m].
    """

def goal_in_view(
    grasp: GraspSeen,
    carrier: int,
    rotation: Array,
    position: Array,
    axis: Array,
    half_angle: float,
    until: float,
    margin: float,
    interest: float,
) -> PathRequirement:
    """Return what makes the rows of `CameraView`.

    Args:
        carrier: Frame that carries the camera: 0 is the base, the joints come after it.
        rotation: Of the camera in that frame. Shape (3, 3).
        position: Likewise. Shape (3,) [m].
        axis: Of the view, unit length, in the camera's axes. Shape (3,).
        margin: By which the goal is further inside the view [rad].
        interest: Values above have no rows [rad, m].
    """

def follows_path(
    positions: Array,
    rotations: Array,
    counts: Sequence[int],
    position: float,
    orientation: float,
) -> PathRequirement:
    """Return what makes the rows of `FollowsPath`.

    Args:
        positions: Of the path, at the times that requirements look at. Shape (times, 3) [m].
        rotations: To inertial axes, those of one time below those of another; empty: the
            orientation is free. Shape (3 times, 3).
        counts: Components of the error that count, 0 to 5, linear first, inertial axes.
        position: Bound of each component of the position [m].
        orientation: Bound of each component of the rotation vector from the path [rad].
    """

class MotionOfPath:
    """A motion at which Python is asked for rows; only as long as that takes."""

    @property
    def x(self) -> Array: ...
    @property
    def q(self) -> Array: ...
    @property
    def v(self) -> Array: ...
    @property
    def q_half_way(self) -> Array: ...
    @property
    def acceleration(self) -> Array: ...
    @property
    def goal_error(self) -> Array: ...
    @property
    def goal_error_by_x(self) -> Array: ...
    @property
    def q_by_x(self) -> Array: ...
    @property
    def v_by_x(self) -> Array: ...
    @property
    def q_half_way_by_x(self) -> Array: ...

class EvaluatedPath:
    """A path with what a program says of it, as `PathLinearisation` has it.

    Where it is not defined, only x and the time of the singularity have a meaning.
    """

    @property
    def x(self) -> Array: ...
    @property
    def q(self) -> Array: ...
    @property
    def v(self) -> Array: ...
    @property
    def q_half_way(self) -> Array: ...
    @property
    def acceleration(self) -> Array: ...
    @property
    def goal_error(self) -> Array: ...
    @property
    def goal_error_by_x(self) -> Array: ...
    @property
    def is_defined(self) -> bool: ...
    @property
    def singular_at(self) -> float | None: ...
    @property
    def objective(self) -> float: ...
    @property
    def violation(self) -> float: ...
    @property
    def value(self) -> float: ...
    @property
    def gradient(self) -> Array: ...
    @property
    def hessian(self) -> Array: ...
    @property
    def max_terms(self) -> Array: ...
    @property
    def max_terms_jacobian(self) -> Array: ...
    @property
    def constraints(self) -> Array: ...
    @property
    def constraints_jacobian(self) -> Array: ...
    @property
    def names(self) -> Indices: ...

class Correction:
    """From a path's motion to another, as `planning.optimisation.program` has it."""

    def __init__(
        self,
        q: Array,  # tangent steps at the points; shape (points, 6 + joints)
        v: Array,  # differences of velocities; likewise
        q_half_way: Array,  # tangent steps half-way; shape (points - 1, 6 + joints)
    ) -> None: ...

class DeadlineOver(Exception):
    """What the core computed has taken longer than its `Deadline` allows."""

class Deadline:
    """A block in which whatever the core computes in this thread raises `DeadlineOver` in time."""

    def __init__(self, seconds: float) -> None: ...  # from the begin of the block
    def __enter__(self) -> None: ...
    def __exit__(self, *exception: object) -> None: ...

class PathProgram:
    """The optimisation problem of Eq. (43) on a time grid."""

    def __init__(
        self,
        paths: PathsOnGrid,
        step: float,  # time from point to point [s]
        objective: PathObjective,
        # With their numbers, by which the names of rows differ; a function returns `Rows`, or None
        requirements: Sequence[tuple[int, PathRequirement | Callable[[MotionOfPath], object]]],
        correction: Correction | None = ...,  # to the motion that requirements are asked of
    ) -> None: ...
    def at(self, x: Array) -> EvaluatedPath:
        """Return objective and constraints of a path with their derivatives."""
