"""Who may come to the console: whoever shows its token, and no page of others."""

from __future__ import annotations

import http.client
from collections.abc import Iterator
from urllib.parse import urlsplit

import pytest
import viser
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from ff_planner_ros.console.access import Access
from ff_planner_ros.console.entries import Entry
from ff_planner_ros.console.page import Page
from ff_planner_ros.console.serve import Served, serve


@pytest.fixture(scope="module")
def served() -> Iterator[Served]:
    entries = [Entry(name, None, status="no answer") for name in ("first", "a 'second' & third")]
    served = serve(lambda server: Page(server, entries), "127.0.0.1", 8700)
    yield served
    served.server.stop()


@pytest.fixture(scope="module")
def cookie(served: Served) -> str:
    """What the address gives."""
    status, _, headers = asked(served, f"/?{urlsplit(served.address).query}")
    assert (status, headers["Location"]) == (303, "/")
    assert "HttpOnly; SameSite=Strict" in headers["Set-Cookie"]
    return headers["Set-Cookie"].partition(";")[0]


def asked(served: Served, path: str, **headers: str) -> tuple[int, bytes, dict[str, str]]:
    """Return status, body and headers of the answer."""
    at = urlsplit(served.address)
    connection = http.client.HTTPConnection(at.hostname or "", at.port, timeout=30)
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    connection.request("GET", path, headers=named)
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer.status, body, dict(answer.getheaders())


def shaken_hands(served: Served, cookie: str, origin: str | None) -> int:
    """Return the status of a websocket's handshake; 101: it is open."""
    at = urlsplit(served.address)
    try:
        with connect(
            f"ws://{at.netloc}",
            origin=origin,  # type: ignore[arg-type]
            additional_headers={"Cookie": cookie} if cookie else {},
            subprotocols=[f"viser-v{viser.__version__}"],  # type: ignore[list-item]
        ):
            return 101
    except InvalidStatus as refused:
        return refused.response.status_code


def test_the_token_in_the_address_gives_a_cookie_that_opens_the_page(
    served: Served, cookie: str
) -> None:
    status, body, _ = asked(served, "/", Cookie=cookie)
    assert status == 200
    assert b"<html" in body
    assert shaken_hands(served, cookie, f"http://{urlsplit(served.address).netloc}") == 101


@pytest.mark.parametrize(
    ("path", "given"),
    [
        ("/", ""),
        ("/?token=", ""),
        ("/?token=another", ""),
        ("/", "ff_planner_console_{port}=another"),
        ("/", "ff_planner_console_1={token}"),
        ("/", "{cookie}x"),
        ("/", "ff_planner_console"),
    ],
)
def test_nobody_else_sees_the_page(served: Served, cookie: str, path: str, given: str) -> None:
    name, _, token = cookie.partition("=")
    port = name.rpartition("_")[2]
    given = given.format(cookie=cookie, token=token, port=port)
    status, body, headers = asked(served, path, Cookie=given)
    assert (status, headers.get("Set-Cookie")) == (403, None)
    assert b"<html" not in body
    assert token.encode() not in body
    assert shaken_hands(served, given, None) == 403


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "http://127.0.0.1:1", "null", "http://127.0.0.1.evil.example"]
)
def test_no_page_of_others_comes_in_by_the_browsers_cookie(
    served: Served, cookie: str, origin: str
) -> None:
    assert shaken_hands(served, cookie, origin) == 403
    assert asked(served, "/", Cookie=cookie, Origin=origin)[0] == 403


def test_a_name_that_was_bound_anew_to_this_machine_is_another_page(
    served: Served, cookie: str
) -> None:
    """The browser takes the cookie of the other name along: it has none."""
    port = urlsplit(served.address).port
    of_other = {"Host": f"evil.example:{port}", "Origin": f"http://evil.example:{port}"}
    assert asked(served, "/", **of_other)[0] == 403
    assert asked(served, "/", Cookie=cookie, Origin=of_other["Origin"])[0] == 403


def test_a_server_that_is_started_unguarded_is_refused() -> None:
    with pytest.raises(RuntimeError, match="unknown way"), Access().guarding():
        pass


def test_a_host_of_another_machine_is_refused() -> None:
    with pytest.raises(OSError, match="assign"):
        serve(lambda server: Page(server, []), "192.0.2.1", 8700)
