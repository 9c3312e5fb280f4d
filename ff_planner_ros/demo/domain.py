"""An unused ROS domain, apart from every system that runs on this host."""

from __future__ import annotations

import os
import socket

# Port numbers of the DDS standard; domains up to 101 stay below Linux' ephemeral ports.
_DOMAINS = range(1, 102)
_FIRST_PORT, _PORTS_PER_DOMAIN, _UNICAST_OFFSET, _PORTS_PER_PARTICIPANT = 7400, 250, 10, 2
_PARTICIPANTS_PROBED = 10

# Domains that this process claims: nobody else can bind an address that is bound.
_claimed_here: set[int] = set()


def private_environment() -> dict[str, str]:
    """Return this process's environment, moved to an unused ROS domain that stays on this host.

    Until this process ends, no other process is given the same domain.

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
        in_use = (_in_use(domain, participant) for participant in range(_PARTICIPANTS_PROBED))
        if _claimed(domain) and not any(in_use):
            return domain
    raise RuntimeError("every ROS domain from 1 to 101 is in use on this host")


def _claimed(domain: int) -> bool:
    """Claim a domain for this process; tell whether the claim holds."""
    if domain in _claimed_here:
        return True
    claim = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        claim.bind(f"\0ff_planner_ros domain {domain}")  # Linux: no file, gone with the process
    except OSError:
        claim.close()
        return False
    claim.detach()  # from Python: the system closes it when the process ends
    _claimed_here.add(domain)
    return True


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
