"""Buttons whose click reaches the server even if the page is being drawn again at that moment."""

from __future__ import annotations

from collections.abc import Callable
from inspect import isawaitable
from typing import Any

from nicegui import ui

from hydro.app.bench import Bench

LOOKS = {
    "first": "unelevated dense no-caps",
    "other": "outline dense no-caps",
    "flat": "flat dense no-caps",
}
"""Properties of Quasar's button for the main action of a panel, another one, and a minor one."""


def button(
    bench: Bench,
    words: str,
    act: Callable[[], Any],
    *,
    look: str = "other",
    key: str = "",
    color: str | None = "primary",
) -> ui.button:
    """Put a button on the page that calls a function of the tab, and return the button.

    The page's script reports a click by the key of the button, and `press` calls the function that has this
    key.  NiceGUI's own event would be lost if the server had just replaced the button and the browser did not
    know it yet.

    Args:
        bench: State of the tab, which keeps the functions by key.
        words: Text on the button.
        act: Function without arguments, or coroutine function.
        look: Name of the button's style, a key of `LOOKS`.
        key: Key of the button; its text by default.
        color: Colour of the button; None for the colour of the text around it.
    """
    bench.actions[key or words] = act
    made = ui.button(words, color=color).props(LOOKS[look])
    made.props.update({"data-do": "press", "data-with": key or words})
    return made


async def press(bench: Bench, key: str) -> None:
    """Call the function of a button.

    Args:
        bench: The workbench.
        key: Key of the button; a key without a function has no effect.
    """
    act = bench.actions.get(key)
    made = act() if act is not None else None
    if isawaitable(made):
        await made
