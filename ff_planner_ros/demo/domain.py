"""A ROS domain of one's own, apart from every system that runs on this host."""

from __future__ import annotations

import os
import socket

# Of the DDS standard's port numbers; domains up to 101 stay below Linux' ephemeral ports.
_DOMAINS = range(1, 102)
_FIRST_PORT, _PORTS_PER_DOMAIN, _UNICAST_OFFSET, _PORTS_PER_PARTICIPANT = 7400, 250, 10, 2
_PARTICIPANTS_PROBED = 10


def private_environment() -> dict[str, str]:
    """Return this process's environment, moved to an unused ROS domain that stays on this host.

    Raises:
        RuntimeError: Every domain is in use.
    """
    return {
        **os.environ,
        "ROS_DOMAIN_ID": str(_unused_domain()),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }


def _unused_domain() -> int:
    # Two that search at the same time start at different places.
    first = os.getpid() % len(_DOMAINS)
    for offset in range(len(_DOMAINS)):
        domain = _DOMAINS[(first + offset) % len(_DOMAINS)]
        if not any(_in_use(domain, participant) for participant in range(_PARTICIPANTS_PROBED)):
            return domain
    raise RuntimeError("every ROS domain from 1 to 101 is in use on this host")


def _in_use(domain: int, participant: int) -> bool:
    """Tell whether a participant listens for others at the port that the standard gives it."""
    port = (
        _FIRST_PORT
        + _PORTS_PER_DOMAIN * domain
        + _UNICAST_OFFSET
        + _PORTS_PER_PARTICIPANT * participant
    )
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("", port))
        except OSError:
            return True
    return False
