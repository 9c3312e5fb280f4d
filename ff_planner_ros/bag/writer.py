"""Write a bag: a directory with one MCAP file and its metadata, as rosbag2 of Jazzy does."""

from __future__ import annotations

import secrets
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from threading import RLock
from types import TracebackType
from typing import Any, Self

import yaml
from mcap.writer import LIBRARY_IDENTIFIER, CompressionType, Writer

from ff_planner_ros.bag.definition import message_definition, type_hash
from ff_planner_ros.errors import BagError

_INT64_MAX = 2**63 - 1  # rosbag2 holds times so, and gives it as start of a bag without messages


@dataclass(frozen=True)
class QualityOfService:
    """What a publisher offers, in the words of rosbag2; everything else is at its default.

    Attributes:
        reliability: `reliable` or `best_effort`.
        durability: `volatile` or `transient_local`.
        history: `keep_last` or `keep_all`.
        depth: Of the history.
    """

    reliability: str = "reliable"
    durability: str = "volatile"
    history: str = "keep_last"
    depth: int = 10


def unique_directory(parent: Path, stem: str) -> Path:
    """Return a directory name that no other bag has: stem, UTC time and a random token.

    Args:
        parent: Directory of all bags.
        stem: What the bag is of.
    """
    # Time and process number can be the same in two containers that share a disk.
    stamp = time.strftime("%Y%m%d_%H%M%S", time.gmtime())
    return parent / f"{stem}_{stamp}_{secrets.token_hex(4)}"


class BagWriter:
    """A bag open for writing; safe to use from several threads.

    A message reaches the operating system at the latest when another one is written that is
    `flush_interval` later, or with `flush`: call that from a timer if messages may stay away.
    After a disk error the bag accepts nothing more; what was flushed before can be recovered.
    """

    def __init__(self, directory: Path, flush_interval: float) -> None:
        """Create the bag.

        Args:
            directory: Created, with its parents; must not exist.
            flush_interval: Log time that a crash can lose at most [s].

        Raises:
            BagError: The directory exists or cannot be written.
        """
        self._directory = directory
        self._flush_interval_ns = round(flush_interval * 1e9)
        self._lock = RLock()
        self._refusal: str | None = None  # why nothing more can be written
        self._schemas: dict[str, int] = {}
        self._topics: dict[str, _Topic] = {}
        self._start_ns = _INT64_MAX
        self._end_ns = 0
        self._unflushed_ns: int | None = None  # log time of the first message not yet flushed

        try:
            directory.mkdir(parents=True)
            self._file = (directory / self._file_name).open("xb")
        except FileExistsError:
            raise BagError(f"bag {directory} exists already, and is not overwritten") from None
        except OSError as error:
            raise BagError(f"bag {directory} cannot be written: {error}") from error
        with self._writing():
            self._mcap = Writer(self._file, compression=CompressionType.ZSTD)
            self._mcap.start(profile="ros2", library=f"ff_planner_ros {LIBRARY_IDENTIFIER}")
            self._write_metadata()
            self._mcap.flush()

    def add_topic(self, topic: str, type_name: str, qos: Sequence[QualityOfService]) -> None:
        """Announce a topic.

        Args:
            topic: Resolved name, with its leading slash.
            type_name: `package/msg/Name` or `package/srv/Name_Event`.
            qos: What each publisher of the topic offers; may be empty.

        Raises:
            BagError: The topic is there already, the type is not installed, the bag is closed,
                or the disk failed.
        """
        definition = message_definition(type_name)
        digest = type_hash(type_name)
        profiles = [_profile(offered) for offered in qos]
        with self._writing():
            if topic in self._topics:
                raise BagError(f"topic {topic} is in bag {self._directory} already")
            if type_name not in self._schemas:
                self._schemas[type_name] = self._mcap.register_schema(
                    type_name, definition.encoding, definition.text.encode()
                )
            channel = self._mcap.register_channel(
                topic,
                "cdr",
                self._schemas[type_name],
                {"offered_qos_profiles": _as_yaml(profiles), "topic_type_hash": digest},
            )
            self._topics[topic] = _Topic(channel, type_name, digest, profiles)

    def write(self, topic: str, cdr: bytes, log_time_ns: int, publish_time_ns: int) -> None:
        """Write one message.

        Args:
            topic: A topic that was added.
            cdr: The serialised message, of exact length (see `encode`).
            log_time_ns: When it was received, since the epoch [ns].
            publish_time_ns: When it was published, since the epoch [ns].

        Raises:
            BagError: Unknown topic, a time that rosbag2 cannot hold, the bag is closed, or the
                disk failed.
        """
        with self._writing():
            if topic not in self._topics:
                raise BagError(
                    f"topic {topic} was not added to bag {self._directory}: "
                    f"it has {sorted(self._topics)}"
                )
            for name, value in (("log", log_time_ns), ("publish", publish_time_ns)):
                if not 0 <= value <= _INT64_MAX:
                    raise BagError(
                        f"{name} time of a message on {topic} is {value}: "
                        "it must be nanoseconds from 0 to 2^63 - 1"
                    )
            info = self._topics[topic]
            self._mcap.add_message(info.channel, log_time_ns, cdr, publish_time_ns, info.count)
            info.count += 1
            self._start_ns = min(self._start_ns, log_time_ns)
            self._end_ns = max(self._end_ns, log_time_ns)
            if self._unflushed_ns is None:
                self._unflushed_ns = log_time_ns
            # A clock that was set back must not put the next flush off.
            elif not 0 <= log_time_ns - self._unflushed_ns < self._flush_interval_ns:
                self.flush()

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Keep a document with the messages, so that the bag explains itself.

        Args:
            name: File name (`robot.urdf`).
            media_type: MIME type (`application/xml`).
            data: The document.

        Raises:
            BagError: The bag is closed, or the disk failed.
        """
        with self._writing():
            self._mcap.add_attachment(0, time.time_ns(), name, media_type, data)
            self._mcap.flush()

    def flush(self) -> None:
        """Hand everything written so far to the operating system.

        Raises:
            BagError: The bag is closed, or the disk failed.
        """
        with self._writing():
            self._mcap.flush()
            self._unflushed_ns = None

    def close(self) -> None:
        """Complete the bag; does nothing if it is closed or has failed.

        Raises:
            BagError: The disk failed.
        """
        with self._lock:
            if self._refusal is None:
                with self._writing():
                    self._mcap.flush()
                    self._write_metadata()
                    self._mcap.finish()
                    self._file.close()
                self._refusal = f"bag {self._directory} is closed"

    def __enter__(self) -> Self:
        """Return the bag itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the bag."""
        self.close()

    @property
    def _file_name(self) -> str:
        return f"{self._directory.resolve().name}_0.mcap"

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Hold the lock, and turn a disk error into the end of this bag."""
        with self._lock:
            if self._refusal is not None:
                raise BagError(self._refusal)
            try:
                yield
            except OSError as error:
                # Part of a record may be on the disk: another one behind it would not be found.
                self._refusal = f"bag {self._directory} cannot be written: {error}"
                with suppress(OSError):
                    self._file.close()
                raise BagError(self._refusal) from error

    def _write_metadata(self) -> None:
        """Write what rosbag2 reads first, beside the MCAP file and into it."""
        metadata = self._metadata()
        self._mcap.add_metadata("rosbag2", {"serialized_metadata": _as_yaml(metadata)})
        path = self._directory / "metadata.yaml"
        partial = path.with_suffix(".partial")
        partial.write_text(_as_yaml({"rosbag2_bagfile_information": metadata}), encoding="utf-8")
        partial.replace(path)

    def _metadata(self) -> dict[str, Any]:
        return {
            "version": 9,
            "storage_identifier": "mcap",
            **self._extent(),
            "topics_with_message_count": [
                {
                    "topic_metadata": {
                        "name": name,
                        "type": topic.type_name,
                        "serialization_format": "cdr",
                        "offered_qos_profiles": topic.profiles,
                        "type_description_hash": topic.type_hash,
                    },
                    "message_count": topic.count,
                }
                for name, topic in self._topics.items()
            ],
            "compression_format": "",  # of whole files or messages; the chunks are compressed
            "compression_mode": "",
            "relative_file_paths": [self._file_name],
            "files": [{"path": self._file_name, **self._extent()}],
            "custom_data": None,
            "ros_distro": "jazzy",
        }

    def _extent(self) -> dict[str, Any]:
        return {
            "duration": {"nanoseconds": max(0, self._end_ns - self._start_ns)},
            "starting_time": {"nanoseconds_since_epoch": self._start_ns},
            "message_count": sum(topic.count for topic in self._topics.values()),
        }


@dataclass
class _Topic:
    channel: int
    type_name: str
    type_hash: str
    profiles: list[dict[str, Any]]
    count: int = 0


def _profile(qos: QualityOfService) -> dict[str, Any]:
    return {
        "history": qos.history,
        "depth": qos.depth,
        "reliability": qos.reliability,
        "durability": qos.durability,
        "deadline": _infinite(),
        "lifespan": _infinite(),
        "liveliness": "automatic",
        "liveliness_lease_duration": _infinite(),
        "avoid_ros_namespace_conventions": False,
    }


def _infinite() -> dict[str, int]:
    return {"sec": 9223372036, "nsec": 854775807}


def _as_yaml(document: Any) -> str:
    return str(yaml.safe_dump(document, sort_keys=False))
