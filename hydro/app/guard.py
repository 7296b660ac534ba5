"""Gate in front of the workbench: only this machine's browser with the token gets through.

Every request, also one that opens a websocket, needs three things.  The header Host names the address of the
server, which stops pages that rebind their name to this machine.  The header Origin, where a browser sends
it, is the server's own, which stops other pages.  The token, from the address or from the cookie that the
address sets, stops other users and programs.
"""

from __future__ import annotations

import hmac
from collections.abc import Iterable
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qsl, urlencode

Scope = dict[str, Any]
PARAMETER = "token"
"""Name of the parameter of the address that has the token."""
SIZE = 413
REFUSED, MISSING = 403, 401
POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; connect-src 'self' ws: wss:; "
    "frame-ancestors 'none'"
)
"""Content security policy: everything comes from the server.  Vue compiles templates, which is an eval."""


class Guard:
    """ASGI application that lets only requests of this machine's browser with the token reach another one."""

    def __init__(self, app: Any, token: str, hosts: Iterable[str], largest: int) -> None:
        """Set the conditions.

        Args:
            app: The application behind the gate.
            token: Secret of this run.
            hosts: Admissible values of the header Host, such as `127.0.0.1:8430`.
            largest: Maximum size of a request's body [bytes].
        """
        self.app, self.token, self.hosts, self.largest = app, token, frozenset(hosts), largest

    async def __call__(self, scope: Scope, receive: Any, send: Any) -> None:
        """Serve one connection."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        headers = {
            name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]
        }
        status, words = self._fault(scope, headers)
        if status:
            await _refuse(scope, receive, send, status, words)
            return
        if scope["type"] == "websocket":
            await self.app(scope, receive, send)
            return
        if self._in_address(scope) and scope["method"] == "GET":
            await _redirect(send, _without_token(scope), self._cookie(scope))
            return
        await self.app(scope, _limited(receive, self.largest), _with_headers(send))

    def _fault(self, scope: Scope, headers: dict[str, str]) -> tuple[int, str]:
        """Return HTTP status and reason to refuse a request; status 0 for an admissible request."""
        host = headers.get("host", "")
        if host not in self.hosts:
            return REFUSED, "this name is not the address of the workbench"
        origin = headers.get("origin")
        if origin is not None and origin not in (f"http://{host}", f"https://{host}"):
            return REFUSED, "another page may not use the workbench"
        given = self._in_address(scope) or _cookie_of(headers, _name(scope))
        if not (given and hmac.compare_digest(given.encode(), self.token.encode())):
            return MISSING, "open the address that hydro app printed: it has the token"
        if (size := headers.get("content-length", "0")).isdigit() and int(size) > self.largest:
            return SIZE, f"the file is larger than {self.largest // 1_000_000} MB; see hydro app --max-upload"
        return 0, ""

    def _in_address(self, scope: Scope) -> str:
        """Return the token of the address; empty without one."""
        return dict(parse_qsl(_query(scope))).get(PARAMETER, "")

    def _cookie(self, scope: Scope) -> str:
        """Return the cookie that keeps the token, for this server alone and for no other page."""
        return f"{_name(scope)}={self.token}; Path=/; HttpOnly; SameSite=Strict"


def _query(scope: Scope) -> str:
    """Return the part of the address after the question mark."""
    query: bytes = scope.get("query_string", b"")
    return query.decode("latin-1")


def _name(scope: Scope) -> str:
    """Return the name of the cookie, which includes the port, because browsers send cookies to all ports."""
    server = scope.get("server") or ("", 0)
    return f"hydro-{server[1]}"


def _cookie_of(headers: dict[str, str], name: str) -> str:
    """Return the value of a cookie in the headers; empty if they lack it."""
    try:
        found = SimpleCookie(headers.get("cookie", "")).get(name)
    except CookieError:
        return ""
    return found.value if found is not None else ""


def _without_token(scope: Scope) -> str:
    """Return the address without the token, so that it does not stay in the address bar and the history."""
    rest = [pair for pair in parse_qsl(_query(scope)) if pair[0] != PARAMETER]
    path = "/" + scope["path"].lstrip("/")
    return f"{path}?{urlencode(rest)}" if rest else path


def _with_headers(send: Any) -> Any:
    """Return a sender that adds the headers of security to a response."""

    async def sending(message: dict[str, Any]) -> None:
        if message["type"] == "http.response.start":
            more = [
                (b"content-security-policy", POLICY.encode()),
                (b"x-content-type-options", b"nosniff"),
                (b"referrer-policy", b"no-referrer"),
            ]
            message = {**message, "headers": [*message.get("headers", []), *more]}
        await send(message)

    return sending


def _limited(receive: Any, largest: int) -> Any:
    """Return a receiver that ends requests with more than `largest` bytes, whatever their header says."""
    seen = 0

    async def receiving() -> dict[str, Any]:
        nonlocal seen
        message: dict[str, Any] = await receive()
        seen += len(message.get("body", b""))
        return {"type": "http.disconnect"} if seen > largest else message

    return receiving


async def _refuse(scope: Scope, receive: Any, send: Any, status: int, words: str) -> None:
    """Answer a request with an HTTP status and one line of text."""
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008, "reason": words})
        return
    await send(
        {
            "type": "http.response.start",
            "status": status,
            "headers": [(b"content-type", b"text/plain; charset=utf-8"), (b"connection", b"close")],
        }
    )
    await send({"type": "http.response.body", "body": f"hydro app: {words}\n".encode()})


async def _redirect(send: Any, path: str, cookie: str) -> None:
    """Answer a request with a redirection to `path`, and set a cookie."""
    headers = [
        (b"location", path.encode()),
        (b"set-cookie", cookie.encode()),
        (b"cache-control", b"no-store"),
        (b"referrer-policy", b"no-referrer"),
    ]
    await send({"type": "http.response.start", "status": 303, "headers": headers})
    await send({"type": "http.response.body", "body": b""})
