"""Record a topic of 1 kHz until killed, again and again, and write down what was published.

Run as `recorder_to_kill.py DIRECTORY SEED KILLS`; `DIRECTORY/N` is the bag of the Nth run and
`DIRECTORY/N.published` holds, for each of its messages, number and time of publication [ns], then
that of the kill; and, numbered 0, when a thread beside the recorder's woke that wakes as often: on
a busy machine both do so late. Imports once: a fork of this process is what gets killed.
"""

from __future__ import annotations

import os
import random
import signal
import struct
import sys
import time
from pathlib import Path
from threading import Thread

import rclpy
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.ros.recorder.recorder import RecordedTopic, Recorder

ENTRY = struct.Struct("<qq")
FLUSH_INTERVAL = 0.25  # [s] the default
SPLIT = 0.2  # [s] length of a file, in every other run
QUEUE = QoSProfile(depth=1000)


def record(directory: Path, max_duration: float, published: int, ready: int) -> None:
    """Publish and record for ever."""
    rclpy.init(args=[])
    node = rclpy.create_node("publisher")
    recorder = Recorder(
        lambda: BagWriter(directory, FLUSH_INTERVAL, max_duration=max_duration),
        directory,
        [RecordedTopic("/text", String, QUEUE)],
        FLUSH_INTERVAL,
        "recorder",
        "/",
        node.get_logger(),
    )
    assert not recorder.health.failure
    publisher = node.create_publisher(String, "/text", QUEUE)
    Thread(target=wake, args=(published,), daemon=True).start()
    os.write(ready, b"!")
    begun, number = time.monotonic(), 0
    while True:
        while number < (time.monotonic() - begun) * 1000.0:
            number += 1
            publisher.publish(String(data=str(number)))
            os.write(published, ENTRY.pack(number, time.time_ns()))
        time.sleep(0.0005)


def wake(published: int) -> None:
    """Write down when a thread wakes that sleeps for as long as the recorder's."""
    while True:
        time.sleep(FLUSH_INTERVAL / 2)
        os.write(published, ENTRY.pack(0, time.time_ns()))


def main(directory: Path, seed: int, kills: int) -> None:
    """Kill as many recorders as asked for, each at a random moment."""
    moments = random.Random(seed)
    for number in range(kills):
        published = os.open(directory / f"{number}.published", os.O_WRONLY | os.O_CREAT)
        readable, ready = os.pipe()
        child = os.fork()
        if child == 0:
            record(directory / str(number), SPLIT * (number % 2), published, ready)
        os.read(readable, 1)
        time.sleep(moments.uniform(0.3, 0.8))
        now = time.time_ns()
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        os.write(published, ENTRY.pack(-1, now))
        for descriptor in (published, readable, ready):
            os.close(descriptor)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
