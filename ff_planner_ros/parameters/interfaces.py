"""Parameters of the node's subscriptions, publications and bags."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from ff_planner_ros.common.arrays import finite_vector, unit_quaternion
from ff_planner_ros.common.forms import a_word
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.settings import tunable

# Definitions and documents alone take a fifth of it [bytes].
_MIN_FILE_SIZE = 1_000_000
_MAX_DEPTH = 10_000
RELIABILITIES, DURABILITIES = ("best_effort", "reliable"), ("volatile", "transient_local")


@dataclass(frozen=True)
class OdometryParameters:
    """The sensor that odometry describes, and how its messages are paired with joint states.

    Raises:
        InvalidInput: The position has not three finite entries, or the quaternion no unit norm.
    """

    child_frame_id: str = tunable(
        "child_frame_id of odometry: the frame of a sensor that is fixed to the chaser"
    )
    sensor_position_in_chaser: tuple[float, ...] = tunable(
        "Origin of the sensor's frame, from the chaser's centre of mass (base link and all that is "
        "fixed to it, without the arm), in axes of the base link",
        unit="m",
    )
    sensor_quaternion_in_chaser_xyzw: tuple[float, ...] = tunable(
        "Rotation from axes of the sensor's frame to axes of the base link; [0.0, 0.0, 0.0, 1.0]: "
        "parallel"
    )
    pairing_tolerance: float = tunable(
        "Largest difference between the stamps of odometry and joint_states that make a state",
        0.0,
        1.0,
        "s",
    )

    def __post_init__(self) -> None:
        """Check the arrays, which no range of a parameter describes."""
        for name, read in (
            ("sensor_position_in_chaser", partial(finite_vector, size=3)),
            ("sensor_quaternion_in_chaser_xyzw", unit_quaternion),
        ):
            vector = read(f"odometry.{name}", getattr(self, name))
            object.__setattr__(self, name, tuple(vector.tolist()))


@dataclass(frozen=True)
class SubscriptionQos:
    """Quality of service that the node requests from publishers."""

    reliability: str = tunable(
        "best_effort hears every publisher; reliable does not connect to publishers that "
        "offer best_effort, and only a warning in the log tells"
    )
    durability: str = tunable(
        "volatile hears every publisher, from now on; transient_local also hears what was "
        "published before, but does not connect to publishers that offer volatile, and only a "
        "warning in the log tells"
    )
    depth: int = tunable("Messages that wait at most; the oldest are dropped", 1, _MAX_DEPTH)


@dataclass(frozen=True)
class PublisherQos:
    """Quality of service that the node offers to subscribers."""

    reliability: str = tunable(
        "reliable is heard by every subscriber; best_effort does not connect to subscribers that "
        "ask for reliable, and only a warning in the log tells"
    )
    durability: str = tunable(
        "transient_local is heard by every subscriber, the last messages also by those that come "
        "late; volatile does not connect to subscribers that ask for transient_local, and only a "
        "warning in the log tells"
    )
    depth: int = tunable(
        "Messages that wait at most, and are kept for those that come late", 1, _MAX_DEPTH
    )


@dataclass(frozen=True)
class QosParameters:
    """Quality of service of every topic.

    Raises:
        InvalidInput: A reliability or durability is unknown.
    """

    chaser_state: SubscriptionQos
    odometry: SubscriptionQos
    joint_states: SubscriptionQos
    obstacles: SubscriptionQos
    target_body: SubscriptionQos
    joint_trajectory: PublisherQos
    predicted_chaser_path: PublisherQos
    predicted_chaser_pose: PublisherQos

    def __post_init__(self) -> None:
        """Check every reliability and durability."""
        for name, topic in vars(self).items():
            a_word(RELIABILITIES).read(f"qos.{name}.reliability", topic.reliability)
            a_word(DURABILITIES).read(f"qos.{name}.durability", topic.durability)


@dataclass(frozen=True)
class RateParameters:
    """Rates of the node's periodic publications."""

    predicted_pose: float = tunable(
        "Rate of predicted_chaser_pose and tracking_error while a plan runs", 0.1, 1000.0, "Hz"
    )
    diagnostics: float = tunable("Rate of /diagnostics", 0.1, 100.0, "Hz")
    preview: float = tunable(
        "Rate of planned_joint_states, which repeat the plan in the preview", 0.1, 1000.0, "Hz"
    )


@dataclass(frozen=True)
class TransformParameters:
    """Which frames the node publishes on /tf, in the inertial frame."""

    measured: bool = tunable(
        "Whether the measured root link of the chaser is published, at rates.predicted_pose: only "
        "if nobody else does"
    )
    predicted_prefix: str = tunable(
        "Prefix of the frames of root link, end effector and target as predicted for now, while a "
        "plan runs; empty: no such frames"
    )
    preview_prefix: str = tunable(
        "Prefix of the frames of links and target in the preview; empty: no such frames"
    )


@dataclass(frozen=True)
class BagParameters:
    """Where the node records its bag, and how.

    Raises:
        InvalidInput: `max_size` is neither 0 nor large enough for a file's definitions.
    """

    directory: str = tunable("Directory in which every start makes a new bag")
    flush_interval: float = tunable(
        "Longest stretch that a crash or a power cut can lose", 0.01, 60.0, "s"
    )
    max_size: int = tunable(
        "A file of the bag ends before it becomes larger, its index not counted, and another one "
        f"is begun; 0: never; else at least {_MIN_FILE_SIZE}",
        minimum=0,
        unit="bytes",
    )
    max_duration: float = tunable(
        "Longest file of the bag, after which another one begins; 0: no limit", 0.0, None, "s"
    )
    owner_only: bool = tunable(
        "true: only the node's user may read the bag (mode 0700 of the directory, 0600 of its "
        "files); false: the process's umask decides"
    )

    def __post_init__(self) -> None:
        """Check the size."""
        if 0 < self.max_size < _MIN_FILE_SIZE:
            raise InvalidInput(
                Status.OUT_OF_RANGE,
                "bag.max_size",
                self.max_size,
                f"it must be 0, for never, or at least {_MIN_FILE_SIZE} [bytes]: each file "
                "repeats the robot and all definitions",
            )
