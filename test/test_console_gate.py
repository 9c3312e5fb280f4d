"""The gate before the console's page: nobody passes who does not show the token."""

from __future__ import annotations

import contextlib
import http.client
import http.server
import threading
from collections.abc import Iterator

import pytest

from ff_planner_ros.console.gate import Gate

TOKEN = "a_token_of_this_test"


class Page(http.server.BaseHTTPRequestHandler):
    """What is behind the gate."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Length", "8")
        self.end_headers()
        self.wfile.write(b"the page")

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Page) as behind:
        thread = threading.Thread(target=behind.serve_forever)
        thread.start()
        yield Gate("127.0.0.1", 0, behind.server_address[1], TOKEN).port
        behind.shutdown()
        thread.join()


def asked(port: int, path: str, **headers: str) -> tuple[int, str, str]:
    """Return status, body and cookie of the answer."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
    connection.request("GET", path, headers={"Connection": "close", **headers})
    answer = connection.getresponse()
    body, cookie = answer.read().decode(), answer.getheader("Set-Cookie") or ""
    connection.close()
    return answer.status, body, cookie


def test_the_token_in_the_address_gives_a_cookie_that_opens_the_page(port: int) -> None:
    status, body, cookie = asked(port, f"/?token={TOKEN}")
    assert (status, body) == (303, "")
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert asked(port, "/", Cookie=cookie.partition(";")[0])[:2] == (200, "the page")


@pytest.mark.parametrize(
    ("path", "cookie"),
    [
        ("/", ""),
        ("/?token=", ""),
        ("/?token=another", ""),
        (f"/{TOKEN}", ""),
        ("/", "ff_planner_console=another"),
        ("/", f"another={TOKEN}"),
        ("/", "ff_planner_console"),
    ],
)
def test_nobody_else_sees_the_page(port: int, path: str, cookie: str) -> None:
    status, body, given = asked(port, path, Cookie=cookie)
    assert (status, given) == (403, "")
    assert "the page" not in body
    assert TOKEN not in body


def test_a_head_without_end_is_no_request(port: int) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
    connection.connect()
    connection.sock.sendall(b"GET / HTTP/1.1\r\nX: " + b"x" * 200_000)
    with contextlib.suppress(ConnectionError):  # closed with unread bytes
        assert connection.sock.recv(100) == b""
    connection.close()


def test_a_port_that_is_taken_is_refused(port: int) -> None:
    with pytest.raises(OSError, match="in use"):
        Gate("127.0.0.1", port, 1, TOKEN)
