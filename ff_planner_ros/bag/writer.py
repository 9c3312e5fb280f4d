"""Writes a bag: a directory with MCAP files and their metadata, as rosbag2 of Jazzy does."""

from __future__ import annotations

import os
import secrets
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import RLock
from typing import Any, Self

from mcap.writer import LIBRARY_IDENTIFIER, CompressionType, Writer

from ff_planner_ros.bag.mcap.definition import ENCODING, Definition, message_definition
from ff_planner_ros.bag.mcap.rosbag2_metadata import (
    INT64_MAX,
    ROSBAG2,
    FileInfo,
    QualityOfService,
    TopicInfo,
    as_yaml,
    metadata,
    profiles,
)
from ff_planner_ros.errors import BagError

# What a message takes in a file beside its own bytes.
_RECORD_OVERHEAD = 31


def unique_directory(parent: Path, stem: str) -> Path:
    """Return a directory name that no other bag has: stem, UTC time and a random token."""
    # Time and process number can be the same in two containers that share a disk.
    stamp = time.strftime("%Y%m%d_%H%M%S", time.gmtime())
    return parent / f"{stem}_{stamp}_{secrets.token_hex(4)}"


class BagWriter:
    """A bag open for writing; safe to use from several threads.

    A message reaches the operating system at the latest when a message is written that is
    `flush_interval` later, or with `flush`: call it from a timer if messages may stay away.
    After a disk error the bag accepts nothing more; what was flushed before can be recovered.

    Every file of a split bag can be read alone: definitions and documents are in each. Latched
    messages are not repeated, as in rosbag2 of Jazzy: played back, a repeated trajectory would be
    a second command.
    """

    def __init__(
        self,
        directory: Path,
        flush_interval: float,
        max_size: int = 0,
        max_duration: float = 0.0,
        *,
        owner_only: bool = False,
    ) -> None:
        """Create the bag.

        Args:
            directory: Created, with its parents; must not exist.
            flush_interval: Log time that a crash can lose at most [s].
            max_size: Largest size of a file without its index; then a new file is begun [bytes];
                0: no limit.
            max_duration: Longest duration of a file; then a new file is begun [s]; 0: no limit.
            owner_only: Whether only the owner may enter the directory and read its files; if not,
                the umask of the process decides.

        Raises:
            BagError: The directory exists or cannot be written.
        """
        self._directory = directory
        self._directory_mode, self._file_mode = (0o700, 0o600) if owner_only else (0o777, 0o666)
        self._flush_interval_ns = round(flush_interval * 1e9)
        self._max_size, self._max_duration_ns = max_size, round(max_duration * 1e9)
        self._lock = RLock()
        self._refusal: str | None = None  # why nothing more can be written
        # As the library takes them: when made and logged [ns], name, media type, content
        self._attachments: list[tuple[int, int, str, str, bytes]] = []
        self._records: dict[str, Mapping[str, str]] = {}
        self._definitions: dict[str, Definition] = {}
        self._topics: dict[str, TopicInfo] = {}
        self._files: list[FileInfo] = []
        self._unflushed_ns: int | None = None  # log time of the first message not yet flushed
        self._unflushed_size = 0
        self._is_on_disk = False
        self.custom_data: dict[str, str] = {}  # goes into the metadata whenever that is written

        try:
            directory.mkdir(self._directory_mode, parents=True)
        except FileExistsError:
            raise BagError(f"bag {directory} exists already, and is not overwritten") from None
        except OSError as error:
            raise BagError(f"bag {directory} cannot be written: {error}") from error
        with self._writing():
            self._begin_file()

    @property
    def message_count(self) -> int:
        """Number of messages written so far; does not wait for one that is being written."""
        return sum(file.message_count for file in self._files)

    def add_topic(self, topic: str, type_name: str, qos: Sequence[QualityOfService]) -> None:
        """Announce a topic.

        Args:
            type_name: `package/msg/Name` or `package/srv/Name_Event`; a part of a service or an
                action is recorded as the message with the same bytes (see `recorded_name`).
            qos: Quality of service of each publisher of the topic; may be empty.

        Raises:
            BagError: The topic is there already, the type is not installed, the bag is closed,
                or the disk failed.
        """
        definition = message_definition(type_name)
        info = TopicInfo(definition.name, definition.hash, profiles(qos))
        with self._writing():
            if topic in self._topics:
                raise BagError(f"topic {topic} is in bag {self._directory} already")
            self._definitions[definition.name] = definition
            self._topics[topic] = info
            self._register(topic)

    def write(self, topic: str, cdr: bytes, log_time_ns: int, publish_time_ns: int) -> None:
        """Write one message.

        Args:
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
                if not 0 <= value <= INT64_MAX:
                    raise BagError(
                        f"{name} time of a message on {topic} is {value}: "
                        "it must be nanoseconds from 0 to 2^63 - 1"
                    )
            size = len(cdr) + _RECORD_OVERHEAD
            if self._is_full(size, log_time_ns):
                self._split()
            info = self._topics[topic]
            self._mcap.add_message(
                self._channels[topic], log_time_ns, cdr, publish_time_ns, info.message_count
            )
            info.message_count += 1
            self._files[-1].count(log_time_ns)
            self._is_on_disk = False
            self._unflushed_size += size
            if self._unflushed_ns is None:
                self._unflushed_ns = log_time_ns
            # A clock that was set back must not put the next flush off.
            elif not 0 <= log_time_ns - self._unflushed_ns < self._flush_interval_ns:
                self._flush()

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Attach a document, by file name (`robot.urdf`) and MIME type, to this and later files.

        Raises:
            BagError: The bag is closed, or the disk failed.
        """
        with self._writing():
            self._attachments.append((0, time.time_ns(), name, media_type, data))
            self._mcap.add_attachment(*self._attachments[-1])
            self._mcap.flush()

    def add_record(self, name: str, data: Mapping[str, str]) -> None:
        """Add a metadata record of MCAP to this and later files.

        Raises:
            BagError: The bag is closed, or the disk failed.
        """
        with self._writing():
            self._records[name] = dict(data)
            self._mcap.add_metadata(name, dict(data))
            self._mcap.flush()

    def flush(self) -> None:
        """Write everything so far to the disk, so that not even a power cut loses it.

        Raises:
            BagError: The bag is closed, or the disk failed.
        """
        with self._writing():
            if not self._is_on_disk:
                self._flush()
                os.fdatasync(self._file.fileno())
                self._is_on_disk = True

    def split(self) -> tuple[Path, Path]:
        """Complete the current file, begin another one, and return both paths.

        Raises:
            BagError: The bag is closed, or the disk failed.
        """
        with self._writing():
            self._split()
            return self._path(self._files[-2]), self._path(self._files[-1])

    def close(self) -> None:
        """Complete the bag; does nothing if it is closed or has failed.

        Raises:
            BagError: The disk failed.
        """
        with self._lock:
            if self._refusal is None:
                with self._writing():
                    self._end_file()
                self._refusal = f"bag {self._directory} is closed"

    def __enter__(self) -> Self:
        """Return the bag itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the bag."""
        self.close()

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
                with suppress(OSError, AttributeError):  # there may be no file yet
                    self._file.close()
                raise BagError(self._refusal) from error

    def _is_full(self, size: int, log_time_ns: int) -> bool:
        """Whether the next message belongs into another file."""
        file = self._files[-1]
        if file.message_count == 0:  # one that is larger than a file must go somewhere
            return False
        if 0 < self._max_duration_ns < log_time_ns - file.start_ns:
            return True
        if self._max_size == 0 or self._file.tell() + self._unflushed_size + size <= self._max_size:
            return False
        self._flush()  # compressed, it may be much less
        return self._file.tell() + size > self._max_size

    def _split(self) -> None:
        self._end_file()
        self._begin_file()

    def _begin_file(self) -> None:
        """Open the next file, with everything in it that is needed to read it alone."""
        name = f"{self._directory.resolve().name}_{len(self._files)}.mcap"
        self._files.append(FileInfo(name))
        path = self._path(self._files[-1])
        self._file = open(path, "xb", opener=self._open)  # noqa: SIM115 (closed in _end_file)
        self._mcap = Writer(self._file, compression=CompressionType.ZSTD)
        self._mcap.start(profile="ros2", library=f"ff_planner_ros {LIBRARY_IDENTIFIER}")
        for attachment in self._attachments:
            self._mcap.add_attachment(*attachment)
        for record, data in self._records.items():
            self._mcap.add_metadata(record, dict(data))
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        for topic in self._topics:
            self._register(topic)
        self._write_metadata()
        self._mcap.flush()

    def _end_file(self) -> None:
        self._flush()
        # Once, though rosbag2 does so at the start, too: other readers warn of the second record.
        document = self._write_metadata()
        self._mcap.add_metadata(ROSBAG2, {"serialized_metadata": as_yaml(document)})
        self._mcap.finish()
        self._file.close()

    def _register(self, topic: str) -> None:
        """Announce a topic in the file, with the definition of its type."""
        info = self._topics[topic]
        if info.type_name not in self._schemas:
            definition = self._definitions[info.type_name]
            self._schemas[info.type_name] = self._mcap.register_schema(
                info.type_name, ENCODING, definition.text.encode()
            )
        self._channels[topic] = self._mcap.register_channel(
            topic,
            "cdr",
            self._schemas[info.type_name],
            {"offered_qos_profiles": as_yaml(info.profiles), "topic_type_hash": info.type_hash},
        )

    def _flush(self) -> None:
        self._mcap.flush()
        self._unflushed_ns, self._unflushed_size = None, 0

    def _write_metadata(self) -> dict[str, Any]:
        """Write `metadata.yaml`, and return its content."""
        document = metadata(self._files, self._topics, self.custom_data)
        path = self._directory / "metadata.yaml"
        partial = path.with_suffix(".partial")
        with open(partial, "w", encoding="utf-8", opener=self._open) as file:
            file.write(as_yaml({"rosbag2_bagfile_information": document}))
        partial.replace(path)
        return document

    def _open(self, path: str, flags: int) -> int:
        """Open a file whose mode is right from its first moment on."""
        return os.open(path, flags, self._file_mode)

    def _path(self, file: FileInfo) -> Path:
        return self._directory / file.name
