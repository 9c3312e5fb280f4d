"""Access control of the page: only for who knows its token, and for no other web page.

The loopback keeps other machines away, but neither other users of this one nor web pages that its
browser has open. So every request, the handshake of a websocket included, must have the token: in
the address, which is answered by a cookie, or in that cookie. Its origin must be this page.
"""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

from websockets.asyncio import server
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

_NEEDS_TOKEN = "The address of this page has a token: take the one that the command printed.\n"
_OTHER_PAGE = "Another page asked for it.\n"


class Access:
    """Accepts or rejects every request to the page's server, before the server sees it."""

    def __init__(self) -> None:
        """Generate the token."""
        self.token = secrets.token_urlsafe(24)
        self.port = 0  # of the server: two consoles have cookies of their own
        self._guards = False

    @contextmanager
    def guarding(self) -> Iterator[None]:
        """Guard a server of viser that is started in this context; viser has no guard of its own.

        Raises:
            RuntimeError: No server was started in a known way, so none is guarded.
        """
        serve: Any = server.serve

        def guarded(*given: Any, process_request: Callable[..., Any], **options: Any) -> Any:
            self._guards = True

            def judged(connection: server.ServerConnection, request: Request) -> Any:
                return self.answer(request) or process_request(connection, request)

            return serve(*given, process_request=judged, **options)

        server.serve = guarded  # type: ignore[assignment, misc]
        try:
            yield
        finally:
            server.serve = serve  # type: ignore[misc]
        if not self._guards:
            raise RuntimeError("this version of viser starts its server in an unknown way")

    def answer(self, request: Request) -> Response | None:
        """Return the response to a request that does not reach the server; None: it may pass."""
        headers = request.headers
        host = headers.get_all("Host")
        if any([urlsplit(origin).netloc] != host for origin in headers.get_all("Origin")):
            return _said(HTTPStatus.FORBIDDEN, _OTHER_PAGE)
        _, _, query = request.path.partition("?")
        if not self._knows(self._cookie_in(headers)):
            if not self._knows(parse_qs(query).get("token", [""])[0]):
                return _said(HTTPStatus.FORBIDDEN, _NEEDS_TOKEN)
            cookie = f"{self._cookie}={self.token}; HttpOnly; SameSite=Strict; Path=/"
            return _said(HTTPStatus.SEE_OTHER, "", Location="/", Set_Cookie=cookie)
        return None

    @property
    def _cookie(self) -> str:
        return f"ff_planner_console_{self.port}"

    def _knows(self, token: str) -> bool:
        return hmac.compare_digest(token.encode(), self.token.encode())

    def _cookie_in(self, headers: Headers) -> str:
        """Return the token of a request's cookie; empty: it has none."""
        for line in headers.get_all("Cookie"):
            try:
                cookies = SimpleCookie(line)
            except CookieError:
                return ""
            if self._cookie in cookies:
                return cookies[self._cookie].value
        return ""


def _said(status: HTTPStatus, words: str, **headers: str) -> Response:
    body = words.encode()
    told = Headers({name.replace("_", "-"): value for name, value in headers.items()})
    told["Content-Type"], told["Content-Length"] = "text/plain", str(len(body))
    return Response(status.value, status.phrase, told, body)
