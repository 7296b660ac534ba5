"""Files that are almost right: what stands in a sound one, with some of it lost, doubled or made another."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any

import numpy as np
import polars as pl
from hypothesis import strategies as st

JUNK: tuple[Any, ...] = (
    *(0, 1, -1, 3, 2**53, -(2**63), 0.0, -0.5, 1e-300, 1e300, float("nan"), float("inf"), float("-inf")),
    *("", "x", "none", "é", "a" * 300, "../..", "1", "\n", True, False, [], [[]], {}, [1.0], ["x"]),
    *([float("nan")] * 6, [0.0] * 6, [1e300] * 6, [[1.0] * 6] * 6, {"x": 1.0}),
)
"""What may stand in the place of any value."""

CELLS = (None, float("nan"), float("inf"), -1e300, 0.0, 1e9)
WAYS = ("lose", "replace", "replace", "rename", "double")
Place = tuple[str | int, ...]


def places(nested: Any, before: Place = ()) -> Iterator[Place]:
    """Where every value of nested dicts and lists stands."""
    inner = (
        nested.items() if isinstance(nested, dict) else enumerate(nested) if isinstance(nested, list) else ()
    )
    for key, value in inner:
        yield (*before, key)
        yield from places(value, (*before, key))


@st.composite
def mutated(draw: st.DrawFn, sound: dict[str, Any]) -> dict[str, Any]:
    """Nested values with one to three of them lost, replaced, renamed or doubled."""
    nested = copy.deepcopy(sound)
    for _ in range(draw(st.sampled_from((1, 1, 2, 3)))):
        somewhere = list(places(nested))
        if somewhere:
            _change(draw, nested, draw(st.sampled_from(somewhere)))
    return nested


def _change(draw: st.DrawFn, nested: dict[str, Any], place: Place) -> None:
    """Change what stands at a place."""
    *way, last = place
    home: Any = nested
    for key in way:
        home = home[key]
    value = home[last]
    number = isinstance(value, int | float) and not isinstance(value, bool)
    what = "scale" if number and draw(st.booleans()) else draw(st.sampled_from(WAYS))
    if what == "lose":
        del home[last]
    elif what == "rename" and isinstance(home, dict):
        home[f"{last}_"] = home.pop(last)
    elif what == "double" and isinstance(home, list):
        home.append(copy.deepcopy(value))
    elif what == "scale":
        home[last] = value * draw(st.sampled_from((-1.0, 0.0, 1e-9, 1e-3, 0.5, 2.0, 1e3, 1e9)))
    else:
        home[last] = copy.deepcopy(draw(st.sampled_from(JUNK)))


@st.composite
def spoilt(draw: st.DrawFn, sound: pl.DataFrame) -> pl.DataFrame:
    """A table that lost columns or rows, or has cells, types or an order that it should not have."""
    frame = sound
    for _ in range(draw(st.integers(1, 2))):
        if frame.is_empty() or not frame.width:
            break
        name = draw(st.sampled_from(frame.columns))
        row = draw(st.integers(0, frame.height - 1))
        what = draw(
            st.sampled_from(("drop", "rename", "text", "whole", "cell", "cut", "reverse", "twice", "none"))
        )
        if what == "drop":
            frame = frame.drop(name)
        elif what == "rename":
            frame = frame.rename({name: f"{name}_"})
        elif what == "text":
            frame = frame.with_columns(pl.lit("x").alias(name))
        elif what == "whole":
            frame = frame.with_columns(pl.lit(draw(st.sampled_from((0, -1, 2**60)))).alias(name))
        elif what == "none":
            frame = frame.with_columns(pl.lit(None).cast(frame[name].dtype).alias(name))
        elif what == "cell" and frame[name].dtype.is_numeric():
            column = frame[name].cast(pl.Float64).to_list()
            column[row] = draw(st.sampled_from(CELLS))
            frame = frame.with_columns(pl.Series(name, column, pl.Float64))
        elif what == "cut":
            frame = frame.head(row)
        elif what == "reverse":
            frame = frame.reverse()
        elif what == "twice":
            frame = pl.concat([frame, frame.slice(row, 1)])
    return frame


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """The bytes cut short, with some bits flipped, with a length made huge, or with a stretch of noise."""
    changed = bytearray(content)
    kind, place = rng.integers(4), int(rng.integers(len(changed)))
    if kind == 0:
        return bytes(changed[: max(place, 1)])
    if kind == 1:
        for _ in range(int(rng.integers(1, 9))):
            changed[int(rng.integers(len(changed)))] ^= 1 << int(rng.integers(8))
    elif kind == 2:
        changed[place : place + 8] = b"\xff" * min(8, len(changed) - place)
    else:
        noise = rng.bytes(min(64, len(changed) - place))
        changed[place : place + len(noise)] = noise
    return bytes(changed)
