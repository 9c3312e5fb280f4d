"""The page's server: on the loopback alone, or behind a gate that wants a token."""

from __future__ import annotations

import secrets
from collections.abc import Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from ipaddress import ip_address

import viser

from ff_planner_ros.console.entries import Entry
from ff_planner_ros.console.gate import Gate
from ff_planner_ros.console.page import Page

_LOOPBACK = "127.0.0.1"
_LABEL = "ff-planner console"


@dataclass(frozen=True, eq=False)
class Served:
    """A page that is served."""

    page: Page
    server: viser.ViserServer
    address: str  # for a browser


def serve(entries: Sequence[Entry], host: str, port: int) -> Served:
    """Serve a page until the process ends.

    Args:
        host: Name or address of this machine: without a token if it is on the loopback.
        port: Where it is taken on the loopback, the next one that is free.

    Raises:
        OSError: Nobody can listen there.
    """
    alone = is_loopback(host)
    with redirect_stdout(StringIO()):  # whose address the page has, is told below
        inner = _Server(
            host=_LOOPBACK, port=port if alone else port + 1, label=_LABEL, verbose=False
        )
    page = Page(inner, entries)
    if alone:
        return Served(page, inner, f"http://{_LOOPBACK}:{inner.get_port()}")
    token = secrets.token_urlsafe(24)
    gate = Gate(host, port, inner.get_port(), token)
    return Served(page, inner, f"http://{host}:{gate.port}/?token={token}")


class _Server(viser.ViserServer):
    """Never asks a server of others for a public address, whatever a browser sends."""

    def request_share_url(self, verbose: bool = True) -> str | None:  # noqa: ARG002 (as viser's)
        return None


def is_loopback(host: str) -> bool:
    """Say whether nobody but this machine can come to a host."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
