"""Parameters of the node's subscriptions, publications and bags."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from ff_planner_ros.common.arrays import finite_vector, unit_quaternion
from ff_planner_ros.common.declared import tunable
from ff_planner_ros.errors import InvalidInput, Status

# Each file repeats the robot and all definitions, which take a fifth of it [bytes].
_MIN_FILE_SIZE = 1_000_000


@dataclass(frozen=True)
class OdometryParameters:
    """The sensor that odometry describes.

    Raises:
        InvalidInput: The position has not three finite entries, or the quaternion no unit norm.
    """

    child_frame_id: str = tunable(
        "chaser", "child_frame_id of odometry: the frame of a sensor fixed to the chaser"
    )
    sensor_position_in_chaser: tuple[float, ...] = tunable(
        (0.0, 0.0, 0.0),
        "The sensor's origin from the chaser's centre of mass, in axes of the base link [m]",
    )
    sensor_quaternion_in_chaser_xyzw: tuple[float, ...] = tunable(
        (0.0, 0.0, 0.0, 1.0), "Rotation from axes of the sensor's frame to axes of the base link"
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
class RateParameters:
    """Rates of the node's periodic publications."""

    predicted_pose: float = tunable(
        10.0,
        "Rate of predicted_chaser_pose and tracking_error while a plan runs [Hz]",
        (0.1, 1000.0),
    )
    diagnostics: float = tunable(1.0, "Rate of /diagnostics [Hz]", (0.1, 100.0))
    preview: float = tunable(
        20.0,
        "Rate of planned_joint_states, which repeat the plan in the preview [Hz]",
        (0.1, 1000.0),
    )


@dataclass(frozen=True)
class TransformParameters:
    """Which frames the node publishes on /tf, in the inertial frame."""

    measured: bool = tunable(
        False, "Whether the chaser's root link as measured is published: only if nobody else does"
    )
    predicted_prefix: str = tunable(
        "predicted/",
        "Prefix of the frames of root link, end effector and target as predicted; empty: none",
    )
    preview_prefix: str = tunable(
        "preview/", "Prefix of the frames of links and target in the preview; empty: none"
    )


@dataclass(frozen=True)
class BagParameters:
    """Where the node records its bag, and how.

    Raises:
        InvalidInput: `max_size` is neither 0 nor large enough for a file's definitions.
    """

    directory: str = tunable("bags", "Directory in which every start makes a new bag")
    flush_interval: float = tunable(
        0.25, "Longest stretch that a crash or a power cut can lose [s]", (0.01, 60.0)
    )
    max_size: int = tunable(
        0, f"Largest file of the bag; 0: any; else at least {_MIN_FILE_SIZE} [bytes]"
    )
    max_duration: float = tunable(
        3600.0, "Longest file of the bag, after which another one begins; 0: no limit [s]"
    )
    owner_only: bool = tunable(
        False,
        "Whether only the node's user may read the bag (modes 0700 and 0600), whatever the umask",
    )

    def __post_init__(self) -> None:
        """Check the size."""
        if 0 < self.max_size < _MIN_FILE_SIZE:
            allowed = f"it must be 0, for never, or at least {_MIN_FILE_SIZE} [bytes]"
            raise InvalidInput(Status.OUT_OF_RANGE, "bag.max_size", self.max_size, allowed)
