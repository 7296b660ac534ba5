from __future__ import annotations

import asyncio
from typing import Any

import pytest

from hydro.app.guard import Guard
from hydro.app.server import bound, is_loopback
from hydro.core.errors import DataError, UsageError

TOKEN = "a" * 20
HOST = "127.0.0.1:8430"
OWN = {"host": HOST, "cookie": f"hydro-8430={TOKEN}"}


class Behind:
    """Application behind the gate: it reads the body, and says that it was reached."""

    def __init__(self) -> None:
        self.reached, self.body = False, 0

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        self.reached = True
        if scope["type"] == "websocket":
            await send({"type": "websocket.accept"})
            return
        while (message := await receive())["type"] == "http.request":
            self.body += len(message["body"])
            if not message.get("more_body"):
                break
        else:
            return
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b"in"})


def ask(
    headers: dict[str, str],
    *,
    query: str = "",
    kind: str = "http",
    method: str = "GET",
    chunks: tuple[bytes, ...] = (b"",),
) -> tuple[Behind, list[dict[str, Any]]]:
    """One request through the gate; what was behind it, and what came back."""
    behind, sent = Behind(), list[dict[str, Any]]()
    guard = Guard(behind, TOKEN, [HOST, "localhost:8430"], largest=100)
    left = list(chunks)

    async def receive() -> dict[str, Any]:
        if kind == "websocket":
            return {"type": "websocket.connect"}
        return {"type": "http.request", "body": left.pop(0), "more_body": bool(left)}

    async def send(message: dict[str, Any]) -> None:
        sent.append(message)

    scope = {
        "type": kind,
        "method": method,
        "path": "/",
        "query_string": query.encode(),
        "headers": [(name.encode(), value.encode()) for name, value in headers.items()],
        "server": ("127.0.0.1", 8430),
    }
    asyncio.run(guard(scope, receive, send))
    return behind, sent


def test_the_address_with_the_token_sets_a_cookie_and_leaves_the_address() -> None:
    behind, sent = ask({"host": HOST}, query=f"token={TOKEN}&tab=x")
    assert not behind.reached
    headers = dict(sent[0]["headers"])
    assert (sent[0]["status"], headers[b"location"]) == (303, b"/?tab=x")
    assert b"HttpOnly" in headers[b"set-cookie"]
    assert b"SameSite=Strict" in headers[b"set-cookie"]
    behind, sent = ask(OWN)
    assert behind.reached
    assert b"content-security-policy" in dict(sent[0]["headers"])


@pytest.mark.parametrize("kind", ["http", "websocket"])
@pytest.mark.parametrize(
    ("headers", "query"),
    [
        ({"host": HOST}, ""),
        ({"host": HOST}, "token=wrong"),
        ({"host": HOST, "cookie": "hydro-8430=" + "b" * 20}, ""),
        ({"host": HOST, "cookie": f"hydro-9999={TOKEN}"}, ""),
        ({**OWN, "host": "evil.example:8430"}, ""),
        ({**OWN, "host": ""}, ""),
        ({**OWN, "origin": "http://evil.example"}, ""),
        ({**OWN, "origin": "http://127.0.0.1:9000"}, ""),
        ({**OWN, "origin": "null"}, ""),
    ],
)
def test_requests_of_others_are_refused(headers: dict[str, str], query: str, kind: str) -> None:
    behind, sent = ask(headers, query=query, kind=kind)
    assert not behind.reached
    if kind == "websocket":
        assert sent[0]["type"] == "websocket.close"
    else:
        assert sent[0]["status"] in (401, 403)


def test_the_own_page_may_open_a_websocket() -> None:
    behind, _ = ask({**OWN, "origin": f"http://{HOST}"}, kind="websocket")
    assert behind.reached


def test_a_body_beyond_the_limit_is_refused_whatever_its_header_says() -> None:
    behind, sent = ask({**OWN, "content-length": "101"}, method="POST")
    assert not behind.reached
    assert sent[0]["status"] == 413
    behind, sent = ask(OWN, method="POST", chunks=(b"x" * 60, b"x" * 60))
    assert behind.body == 60
    assert sent == []
    behind, _ = ask(OWN, method="POST", chunks=(b"x" * 60, b"x" * 40))
    assert behind.body == 100


def test_the_server_listens_on_this_machine_unless_told_otherwise() -> None:
    address, listening = bound("127.0.0.1", 0, None)
    with listening:
        assert is_loopback(address.host)
        assert len(address.token) >= 24
        assert f":{address.port}/?token=" in address.link
        with pytest.raises(DataError, match="--port"):
            bound("127.0.0.1", address.port, None)
    assert not is_loopback("0.0.0.0")
    with pytest.raises(UsageError, match="numeric"):
        bound("example.org", 0, None)
    with pytest.raises(UsageError, match="--token"):
        bound("127.0.0.1", 0, "short")
