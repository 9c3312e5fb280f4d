"""What the reader of rosbag2 (Jazzy) needs of a bag, checked without rosbag2.

Written after `rosbag2_storage/yaml.hpp`, `rosbag2_storage/qos.cpp` and
`rosbag2_storage_mcap/mcap_storage.cpp` of branch `jazzy`: every scalar is read as the type that
they convert it to, and what they leave to trust is checked, too.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

import yaml
from mcap.reader import make_reader
from mcap.records import Channel, Schema
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

INT64_MAX = 2**63 - 1
# rmw/qos_string_conversions.h
POLICIES = {
    "history": {"system_default", "keep_last", "keep_all"},
    "reliability": {"system_default", "reliable", "best_effort", "best_available"},
    "durability": {"system_default", "transient_local", "volatile", "best_available"},
    "liveliness": {"system_default", "automatic", "manual_by_topic", "best_available"},
}
HASH = re.compile(r"RIHS01_[0-9a-f]{64}")


def check_bag(directory: Path) -> None:
    """Fail where rosbag2 would refuse or misunderstand a complete bag."""
    document = _load((directory / "metadata.yaml").read_text(encoding="utf-8"))
    metadata = document["rosbag2_bagfile_information"]
    check_metadata(metadata)
    names = [file["path"] for file in metadata["files"]]
    assert names == [f"{directory.name}_{number}.mcap" for number in range(len(names))]
    assert sorted(names) == sorted(path.name for path in directory.glob("*.mcap"))
    counts = {
        topic["topic_metadata"]["name"]: int(topic["message_count"])
        for topic in metadata["topics_with_message_count"]
    }
    found = dict.fromkeys(counts, 0)
    for file in metadata["files"]:
        in_file = _check_file(directory / file["path"], file)
        assert in_file.keys() == counts.keys()
        found = {topic: count + in_file[topic] for topic, count in found.items()}
    assert found == counts


def check_metadata(metadata: dict[str, Any]) -> None:
    """Fail where `convert<BagMetadata>::decode` would, or the numbers contradict each other."""
    assert _integer(metadata["version"], 2**31 - 1) == 9
    assert metadata["storage_identifier"] == "mcap"
    assert metadata["ros_distro"] == "jazzy"
    # Anything else is taken for the compression of whole files or messages.
    assert metadata["compression_format"] == metadata["compression_mode"] == ""
    for key, value in metadata["custom_data"].items():
        assert isinstance(key, str)
        assert isinstance(value, str)
    assert metadata["relative_file_paths"] == [file["path"] for file in metadata["files"]]
    extents = [_extent(file) for file in metadata["files"]]
    start, end, count = _extent(metadata)
    assert start == min(extent[0] for extent in extents)
    assert end == start + max([0, *(extent[1] - start for extent in extents if extent[2])])
    assert count == sum(extent[2] for extent in extents)
    topics = metadata["topics_with_message_count"]
    assert count == sum(_integer(topic["message_count"]) for topic in topics)
    for topic in topics:
        about = topic["topic_metadata"]
        assert about["name"].startswith("/")
        assert re.fullmatch(r"\w+/(msg|srv|action)/\w+", about["type"])
        assert about["serialization_format"] == "cdr"
        assert HASH.fullmatch(about["type_description_hash"])
        _check_profiles(about["offered_qos_profiles"])


def _check_file(path: Path, file: dict[str, Any]) -> dict[str, int]:
    """Check one MCAP file on its own, and return the number of messages of each topic."""
    start, end, count = _extent(file)
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert reader.get_header().profile == "ros2"
        assert summary is not None
        statistics = summary.statistics
        assert statistics is not None  # rosbag2 takes it without asking
        assert statistics.message_count == count
        if count:
            assert statistics.message_start_time == start
            assert statistics.message_end_time == end
        assert sum(len(one.message_index_offsets) > 0 for one in summary.chunk_indexes) == len(
            summary.chunk_indexes
        )
        embedded = [one.metadata for one in reader.iter_metadata() if one.name == "rosbag2"]
        assert len(list(reader.iter_messages())) == count
    (one,) = embedded  # of several, rosbag2 takes the last, and other readers warn
    last = _load(one["serialized_metadata"])
    check_metadata(last)
    assert last["files"][-1] == file
    for channel in summary.channels.values():
        _check_channel(channel, summary.schemas[channel.schema_id])
    counts = statistics.channel_message_counts
    return {one.topic: counts.get(one.id, 0) for one in summary.channels.values()}


def _check_channel(channel: Channel, schema: Schema) -> None:
    assert channel.message_encoding == "cdr"
    _check_profiles(_load(channel.metadata["offered_qos_profiles"]))
    assert schema.encoding == "ros2msg"
    # The definition is complete if it has the hash of the type.
    computed = _hash(schema.name, schema.data.decode())
    assert channel.metadata["topic_type_hash"] == computed


@cache
def _hash(name: str, definition: str) -> str:
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, name))
    return store.hash_rihs01(name)


def _check_profiles(profiles: Any) -> None:
    assert isinstance(profiles, list)
    for profile in profiles:
        for policy, words in POLICIES.items():
            assert profile[policy] in words
        _integer(profile["depth"], 2**31 - 1)
        for duration in ("deadline", "lifespan", "liveliness_lease_duration"):
            _integer(profile[duration]["sec"])
            _integer(profile[duration]["nsec"])
        assert profile["avoid_ros_namespace_conventions"] in ("true", "false")


def _extent(described: dict[str, Any]) -> tuple[int, int, int]:
    """First and last log time [ns], number of messages."""
    start = _integer(described["starting_time"]["nanoseconds_since_epoch"], INT64_MAX)
    duration = _integer(described["duration"]["nanoseconds"], INT64_MAX)
    return start, start + duration, _integer(described["message_count"])


def _integer(text: Any, largest: int = 2**64 - 1) -> int:
    """Read a scalar as yaml-cpp reads an unsigned integer."""
    assert isinstance(text, str)
    assert re.fullmatch(r"\d+", text), text
    assert int(text) <= largest
    return int(text)


def _load(text: str) -> Any:
    """Read YAML as yaml-cpp does: a scalar is a text until somebody converts it."""
    return yaml.load(text, Loader=yaml.BaseLoader)
