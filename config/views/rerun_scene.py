"""Write a bag as a recording of Rerun with the markers of plan and scene, which Rerun leaves out.

pip install rerun-sdk mcap-ros2-support
python rerun_scene.py BAG.mcap planner.rrd
rerun planner.rrd
"""

import sys
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
from mcap_ros2.reader import read_ros2_messages
from rerun_blueprint import blueprint


class Type(IntEnum):
    """Types of visualization_msgs/Marker that the planner uses."""

    CUBE = 1
    SPHERE = 2
    LINE_STRIP = 4
    LINE_LIST = 5
    TEXT_VIEW_FACING = 9
    TRIANGLE_LIST = 11


def drawn(marker: Any) -> list[rr.AsComponents]:
    """Return what Rerun draws of a marker; of the first, which deletes those before, nothing."""
    colour, size, turn = marker.color, marker.scale, marker.pose.orientation
    shade = [round(255 * part) for part in (colour.r, colour.g, colour.b, colour.a)]
    at = [[marker.pose.position.x, marker.pose.position.y, marker.pose.position.z]]
    pose = rr.InstancePoses3D(translations=at, quaternions=[[turn.x, turn.y, turn.z, turn.w]])
    points = np.array([[point.x, point.y, point.z] for point in marker.points]).reshape(-1, 3)
    solid = {
        "half_sizes": [[size.x / 2, size.y / 2, size.z / 2]],
        "colors": shade,
        "fill_mode": "solid",
    }
    lines = {"radii": size.x / 2, "colors": shade}
    match marker.type:
        case Type.CUBE:
            return [rr.Boxes3D(**solid), pose]
        case Type.SPHERE:
            return [rr.Ellipsoids3D(**solid), pose]
        case Type.TRIANGLE_LIST:
            return [rr.Mesh3D(vertex_positions=points, albedo_factor=shade), pose]
        case Type.LINE_STRIP:
            return [rr.LineStrips3D([points], **lines)]
        case Type.LINE_LIST:
            return [rr.LineStrips3D(points.reshape(-1, 2, 3), **lines)]
        case Type.TEXT_VIEW_FACING:
            return [rr.Points3D(at, colors=shade, labels=marker.text, show_labels=True)]
    return []


def write(bag: Path, made: Path) -> None:
    """Write a bag and its markers, with the blueprint; the markers of a message replace others."""
    recording = rr.RecordingStream(bag.stem)
    recording.save(made, default_blueprint=blueprint())
    recording.log_file_from_path(bag)
    for number, message in enumerate(read_ros2_messages(bag, topics=["/markers"])):
        now = np.datetime64(message.log_time_ns, "ns")
        if number:  # just before: at the same time Rerun would clear what is logged after, too
            recording.set_time("message_log_time", timestamp=now - 1)
            recording.log("drawn", rr.Clear(recursive=True))
        recording.set_time("message_log_time", timestamp=now)
        for marker in message.ros_msg.markers:
            if parts := drawn(marker):
                entity, frame = f"drawn/{marker.ns}/{marker.id}", marker.header.frame_id
                recording.log(entity, rr.CoordinateFrame(frame), static=True)
                recording.log(entity, *parts)


if __name__ == "__main__":
    write(*map(Path, sys.argv[1:]))
