"""Server of the workbench: routes, gate, and the run until Ctrl-C."""

from __future__ import annotations

import ipaddress
import secrets
import socket
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hydro.app.desk import Desk
from hydro.app.guard import PARAMETER, Guard
from hydro.core.errors import DataError, UsageError

LOOPBACK = "127.0.0.1"
NAMES = ("localhost", "127.0.0.1", "[::1]")
"""Names of this machine that a browser may use."""
SLACK = 65536
"""Bytes of a request's body beyond the largest upload [bytes]."""
CACHED = {"cache-control": "public, max-age=86400"}
STATIC = Path(__file__).with_name("static")


@dataclass(frozen=True)
class Address:
    """Address at which the server of the workbench listens, with the secret of this run.

    Attributes:
        host: Address that it listens on.
        port: TCP port.
        token: Secret of this run.
    """

    host: str
    port: int
    token: str

    @property
    def name(self) -> str:
        """Host and port as a browser writes them."""
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"

    @property
    def link(self) -> str:
        """URL that opens the page, with the token."""
        return f"http://{self.name}/?{PARAMETER}={self.token}"

    @property
    def hosts(self) -> tuple[str, ...]:
        """Values of the HTTP header Host that the server accepts."""
        return (self.name, *(f"{name}:{self.port}" for name in NAMES))


def bound(host: str, port: int, token: str | None) -> tuple[Address, socket.socket]:
    """Return an address for the server, and a socket that listens at it.

    Args:
        host: Numeric address to listen on.
        port: TCP port; 0 for any free one.
        token: Secret; by default a random one.

    Raises:
        UsageError: The host is not a numeric address, or the token is too short.
        DataError: The port is taken.
    """
    if token is not None and (len(token) < 8 or not token.isascii() or not token.isalnum()):
        raise UsageError("--token: use at least 8 letters and digits")
    try:
        ipaddress.ip_address(host)
    except ValueError:
        raise UsageError(f"--host {host}: give a numeric address, such as {LOOPBACK}") from None
    made = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        made.bind((host, port))
    except OSError as error:
        made.close()
        reason = (error.strerror or str(error)).lower()
        raise DataError(f"{host}:{port}: {reason}; choose another port with --port") from error
    made.listen(16)
    return Address(host, made.getsockname()[1], token or secrets.token_urlsafe(24)), made


def is_loopback(host: str) -> bool:
    """Return whether a numeric address can be reached from this machine only."""
    return ipaddress.ip_address(host).is_loopback


def plotly_script() -> Path:
    """Return the path of the script that draws the curves, which the package plotly ships.

    The package is not imported.

    Raises:
        DataError: The package is not installed.
    """
    found = find_spec("plotly")
    if found is None or found.origin is None:
        raise DataError("plotly is not installed: pip install 'deep-hydro-sim[app]'")
    return Path(found.origin).with_name("package_data") / "plotly.min.js"


def application(desk: Desk, address: Address) -> Guard:
    """Return the web application with scripts, uploads and the page, behind the check of each request."""
    from fastapi import FastAPI, Request
    from fastapi.responses import FileResponse, PlainTextResponse, Response
    from nicegui import ui

    from hydro.app import page, uploads

    inner = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)

    @inner.get("/plotly.min.js")
    def script() -> Response:
        """Return the script that draws the curves, from the plotly package."""
        return FileResponse(plotly_script(), media_type="text/javascript", headers=CACHED)

    @inner.get("/static/{name}")
    def static(name: str) -> Response:
        """Return the page's own script or style."""
        if name not in ("workbench.js", "workbench.css"):
            return PlainTextResponse("not found", status_code=404)
        return FileResponse(STATIC / name, headers=CACHED)

    async def upload(request: Request) -> Response:
        """Store a file that the page sends, and answer with its path."""
        name = request.query_params.get("name", "")
        try:
            path = await uploads.store(desk.places, name, request.stream(), desk.largest)
        except DataError as error:
            return PlainTextResponse(str(error), status_code=400)
        desk.uploaded.append(str(path))
        return PlainTextResponse(str(path))

    inner.add_route("/upload", upload, methods=["POST"])
    page.build(desk, version("deep-hydro-sim"))
    ui.run_with(
        inner,
        title="hydro workbench",
        reconnect_timeout=20.0,
        gzip_middleware_factory=None,
        tailwind=False,
        show_welcome_message=False,
    )
    return Guard(inner, address.token, address.hosts, desk.largest + SLACK)


def serve(desk: Desk, address: Address, listening: socket.socket, ready: Callable[[], Any]) -> None:
    """Run the server until it is interrupted; then end the workers and remove the uploads.

    Args:
        desk: State of the server.
        address: Address of the server.
        listening: Socket that listens at the address.
        ready: Called once the server answers.
    """
    import uvicorn

    class Server(uvicorn.Server):
        """Server that prepares the work, and calls `ready`, once it answers."""

        async def startup(self, sockets: list[socket.socket] | None = None) -> None:
            """Start the server and the worker of the first tab, and call `ready`."""
            await super().startup(sockets)
            desk.prepare()
            ready()

    config = uvicorn.Config(
        application(desk, address),
        log_level="warning",
        access_log=False,
        ws="websockets-sansio",
        lifespan="on",
    )
    try:
        Server(config).run(sockets=[listening])
    except KeyboardInterrupt:
        pass
    finally:
        desk.close()
        listening.close()
