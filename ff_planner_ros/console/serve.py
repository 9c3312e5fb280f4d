"""The page's server: on the loopback unless told otherwise, with a token in the address."""

from __future__ import annotations

import socket
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO

import viser

from ff_planner_ros.console.access import Access
from ff_planner_ros.console.page import Page

_LABEL = "ff-planner console"


@dataclass(frozen=True, eq=False)
class Served:
    """A page that is served."""

    page: Page
    server: viser.ViserServer
    address: str  # for a browser


def serve(page_on: Callable[[viser.ViserServer], Page], host: str, port: int) -> Served:
    """Serve a page until the process ends.

    Args:
        page_on: Builds the page on a server.
        host: Name or address of this machine.
        port: Port; if it is taken, the next free one is used.

    Raises:
        OSError: `host` is no name or address of this machine.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    socket.create_server((host, 0), family=family).close()  # viser would look for a port for ever
    access = Access()
    # viser prints an address without the token.
    with redirect_stdout(StringIO()), access.guarding():
        server = _Server(host=host, port=port, label=_LABEL, verbose=False)
    access.port = server.get_port()
    server.gui.configure_theme(
        control_width="large",
        show_logo=False,
        show_share_button=False,  # it would ask a server of others for a public address
    )
    server.gui.main_panel.dock_right()
    server.gui.set_panel_label(_LABEL)
    page = page_on(server)
    at = f"[{host}]" if ":" in host else host
    return Served(page, server, f"http://{at}:{access.port}/?token={access.token}")


class _Server(viser.ViserServer):
    """Never requests a public address from viser's share server, whatever a browser sends."""

    def request_share_url(self, verbose: bool = True) -> str | None:  # noqa: ARG002 (as viser's)
        return None
