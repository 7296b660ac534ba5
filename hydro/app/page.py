"""The page: its frame appears at once, and is filled as soon as the libraries of the physics are loaded."""

from __future__ import annotations

import asyncio
from importlib import import_module

from nicegui import ui

from hydro.app.desk import Desk
from hydro.app.frame import Frame

STATIC = "/static"
"""Address of the page's script and style."""
PATIENCE = 30.0
"""Time that a browser has to connect [s]."""
PARTS = "hydro.app.layout"
"""Module of the parts of the page, which loads numba, scipy and the physics."""
HEAD = """
<link rel="stylesheet" href="{0}/workbench.css?{1}">
<script src="{0}/workbench.js?{1}"></script>
"""


def build(desk: Desk, version: str) -> None:
    """Register the page with NiceGUI.

    Args:
        desk: State of the server.
        version: Version of the package, so that a browser does not use an older script.
    """

    @ui.page("/", title="hydro workbench", favicon="🌊")
    async def index(tab: str = "") -> None:
        """Show a tab: the one that the address names, or a new one."""
        ui.add_head_html(HEAD.format(STATIC, version))
        frame = Frame()
        await ui.context.client.connected(timeout=PATIENCE)
        await asyncio.to_thread(import_module, PARTS)
        from hydro.app.bench import Bench
        from hydro.app.layout import Layout

        bench = Bench(desk, desk.tab(tab))
        Layout(bench, frame).fill()
        ui.run_javascript(f"history.replaceState(null, '', '/?tab={bench.tab.name}'); workbench.listen()")
        await bench.start()

    _ = index
