"""A gate before the page: who comes from elsewhere must know a token.

The page's server knows no access control. It listens on the loopback alone, and the gate passes a
connection on once its first request shows the token: in the address, which is answered by a cookie,
or in that cookie, as the page's own requests do.
"""

from __future__ import annotations

import asyncio
import hmac
from http.cookies import CookieError, SimpleCookie
from threading import Event, Thread
from urllib.parse import parse_qs, urlsplit

_COOKIE = "ff_planner_console"
_END = b"\r\n\r\n"
_MOST_HEAD = 32_768  # bytes of a request's head
_PATIENCE = 10.0  # for a request's head [s]
_PIECE = 65_536
_REFUSED = (
    b"HTTP/1.1 403 Forbidden\r\nContent-Type: text/plain\r\nConnection: close\r\n\r\n"
    b"The address of this page has a token: take the one that the command printed.\n"
)


class Gate:
    """Listens in a thread of its own, until the process ends."""

    def __init__(self, host: str, port: int, behind: int, token: str) -> None:
        """Begin to listen.

        Args:
            port: Zero: any that is free.
            behind: Port of the page's server on the loopback.

        Raises:
            OSError: The port is taken, or the host is none of this machine's.
        """
        self._behind, self._token = behind, token
        self._error: OSError | None = None
        self.port = port  # that it listens on
        ready = Event()
        Thread(
            target=lambda: asyncio.run(self._serve(host, ready)), name="console gate", daemon=True
        ).start()
        ready.wait()
        if self._error is not None:
            raise self._error

    async def _serve(self, host: str, ready: Event) -> None:
        try:
            server = await asyncio.start_server(self._admit, host, self.port, limit=_MOST_HEAD)
        except OSError as error:
            self._error = error
            ready.set()
            return
        self.port = server.sockets[0].getsockname()[1]
        ready.set()
        async with server:
            await server.serve_forever()

    async def _admit(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Pass a connection on, give it the cookie, or refuse it."""
        try:
            async with asyncio.timeout(_PATIENCE):
                head = await reader.readuntil(_END)
            if self._knows(_cookie_in(head)):
                await self._pass_on(head, reader, writer)
            elif self._knows(_token_in(head)):
                cookie = f"{_COOKIE}={self._token}; HttpOnly; SameSite=Strict; Path=/"
                answer = f"HTTP/1.1 303 See Other\r\nLocation: /\r\nSet-Cookie: {cookie}\r\n"
                writer.write(f"{answer}Content-Length: 0\r\nConnection: close\r\n\r\n".encode())
                await writer.drain()
            else:
                writer.write(_REFUSED)
                await writer.drain()
        except (OSError, TimeoutError, asyncio.IncompleteReadError, asyncio.LimitOverrunError):
            pass  # they went away, or sent no request
        finally:
            writer.close()

    def _knows(self, token: str) -> bool:
        return hmac.compare_digest(token.encode(), self._token.encode())

    async def _pass_on(
        self, head: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        inner_reader, inner_writer = await asyncio.open_connection("127.0.0.1", self._behind)
        try:
            inner_writer.write(head)
            async with asyncio.TaskGroup() as both:
                both.create_task(_copied(reader, inner_writer))
                both.create_task(_copied(inner_reader, writer))
        except* OSError:
            pass
        finally:
            inner_writer.close()


async def _copied(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Copy until one side ends, and end the other then."""
    try:
        while piece := await reader.read(_PIECE):
            writer.write(piece)
            await writer.drain()
    finally:
        writer.close()


def _token_in(head: bytes) -> str:
    """Return the token of a request's address; empty: it has none."""
    words = head.partition(b"\r\n")[0].decode("latin-1").split(" ")
    if len(words) != 3:
        return ""
    return parse_qs(urlsplit(words[1]).query).get("token", [""])[0]


def _cookie_in(head: bytes) -> str:
    """Return the token of a request's cookie; empty: it has none."""
    for line in head.decode("latin-1").split("\r\n")[1:]:
        name, _, value = line.partition(":")
        if name.strip().lower() == "cookie":
            try:
                cookies = SimpleCookie(value.strip())
            except CookieError:
                return ""
            if _COOKIE in cookies:
                return cookies[_COOKIE].value
    return ""
