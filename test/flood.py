"""A process that publishes states at 1 kHz and 2000 spheres at 10 Hz, until it is killed."""

from __future__ import annotations

import time

from ff_planner_msgs.msg import ObstacleSphere
from quick_capture import resting_capture
from ros_processes import Scene, connected_client

RATE, SPHERES_EVERY, SPHERES = 1000, 100, 2000


def main() -> None:
    scene = Scene(resting_capture())
    state, crowd = scene.state(0), scene.obstacles()
    far = [ObstacleSphere(id=f"far {number}", radius=0.1) for number in range(SPHERES)]
    for number, sphere in enumerate(far):
        sphere.center.x, sphere.center.y = 50.0 + number % 50, 50.0 + number // 50
    crowd.spheres = [*crowd.spheres, *far]
    with connected_client() as client:
        begun, sent = time.monotonic(), 0
        while True:
            state.header.stamp = client.node.get_clock().now().to_msg()
            client.publish_state(state)
            if sent % SPHERES_EVERY == 0:
                client.publish_obstacles(crowd)
            sent += 1
            # Each at its own time since the beginning: one that is late makes the next ones hurry.
            time.sleep(max(0.0, begun + sent / RATE - time.monotonic()))


if __name__ == "__main__":
    main()
