"""The metadata of a bag as in rosbag2 of Jazzy: `metadata.yaml`, version 9."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import yaml

from ff_planner_ros.common.yaml_file import yaml_document
from ff_planner_ros.errors import InvalidInput

ROSBAG2 = "rosbag2"  # the metadata record of MCAP that holds the same
INT64_MAX = 2**63 - 1  # rosbag2 holds times so, and gives it as start of a file without messages
_INFINITE = {"sec": 9223372036, "nsec": 854775807}
# That of libyaml is ten times as fast; not every system has it.
_Dumper: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)


@dataclass(frozen=True)
class QualityOfService:
    """QoS that a publisher offers, in the words of rosbag2; all other policies are default."""

    reliability: str = "reliable"  # `reliable` or `best_effort`
    durability: str = "volatile"  # `volatile` or `transient_local`
    history: str = "keep_last"  # `keep_last` or `keep_all`
    depth: int = 10  # of the history


@dataclass
class TopicInfo:
    """A topic of a bag."""

    type_name: str  # `package/msg/Name`
    type_hash: str  # RIHS01 of the type
    profiles: Any  # what each publisher offers, as rosbag2 writes it down
    message_count: int = 0  # in all files


@dataclass
class FileInfo:
    """A file of a bag."""

    name: str  # without directory
    start_ns: int = INT64_MAX  # earliest log time [ns]
    end_ns: int = 0  # latest log time [ns]
    message_count: int = 0  # of all topics

    def count(self, log_time_ns: int) -> None:
        """Count one more message, with its log time [ns]."""
        self.start_ns = min(self.start_ns, log_time_ns)
        self.end_ns = max(self.end_ns, log_time_ns)
        self.message_count += 1


def metadata(
    files: Sequence[FileInfo], topics: Mapping[str, TopicInfo], custom_data: Mapping[str, str]
) -> dict[str, Any]:
    """Return the metadata of a bag, as rosbag2 stores them in `metadata.yaml` and in every file.

    The files are in the order of recording; rosbag2 does not interpret `custom_data`.
    """
    return {
        "version": 9,
        "storage_identifier": "mcap",
        **_extent(files),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": name,
                    "type": topic.type_name,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": topic.profiles,
                    "type_description_hash": topic.type_hash,
                },
                "message_count": topic.message_count,
            }
            for name, topic in topics.items()
        ],
        "compression_format": "",  # of whole files or messages; the chunks are compressed
        "compression_mode": "",
        "relative_file_paths": [file.name for file in files],
        "files": [{"path": file.name, **_extent([file])} for file in files],
        "custom_data": dict(custom_data),
        "ros_distro": "jazzy",
    }


def custom_data(record: Mapping[str, str]) -> dict[str, str]:
    """Return `custom_data` from a metadata record of rosbag2; empty if it cannot be read."""
    try:
        written = record["serialized_metadata"]
        kept = yaml_document(written, "serialized_metadata", "damaged")["custom_data"] or {}
        return {str(key): str(value) for key, value in kept.items()}
    except (InvalidInput, LookupError, TypeError, ValueError, AttributeError):
        return {}


def profiles(qos: Sequence[QualityOfService]) -> list[dict[str, Any]]:
    """Return the QoS profiles that publishers offer, in the format of rosbag2."""
    return [
        {
            "history": offered.history,
            "depth": offered.depth,
            "reliability": offered.reliability,
            "durability": offered.durability,
            "deadline": dict(_INFINITE),
            "lifespan": dict(_INFINITE),
            "liveliness": "automatic",
            "liveliness_lease_duration": dict(_INFINITE),
            "avoid_ros_namespace_conventions": False,
        }
        for offered in qos
    ]


def as_yaml(document: Any) -> str:
    """Return a document as YAML."""
    return str(yaml.dump(document, Dumper=_Dumper, sort_keys=False))


def _extent(files: Sequence[FileInfo]) -> dict[str, Any]:
    start_ns = min(file.start_ns for file in files)
    end_ns = max(file.end_ns for file in files)
    return {
        "duration": {"nanoseconds": max(0, end_ns - start_ns)},
        "starting_time": {"nanoseconds_since_epoch": start_ns},
        "message_count": sum(file.message_count for file in files),
    }
