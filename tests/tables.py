"""Sound tables for tests: plain recordings, long ones cut short, strategies made from the schema files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hydro.io import schema, table
from hydro.io.schema_field import Field

TYPES = {
    "float32": pl.Float32,
    "float64": pl.Float64,
    "int32": pl.Int32,
    "int64": pl.Int64,
    "string": pl.String,
}
texts = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=12)


def shorten(folder: Path, seconds: float, sessions: int | None = None) -> None:
    """Cut every session of the recordings in a folder to its beginning; keep all or the first `sessions`."""
    for path in folder.glob("*.parquet"):
        if path.name.endswith(".covariance.parquet"):
            continue
        whole = table.read(path, ("raw",))
        since = pl.col("t") - pl.col("t").first().over("session")
        number = pl.col("session").rle_id()
        short = whole.frame.filter(since < seconds, number < (sessions or whole.frame.height))
        table.write(table.make("raw", short, stage="import", vehicle_text=whole.provenance.vehicle), path)


def shorten_text(path: Path, rows: int) -> None:
    """Cut a log of text to its header and so many rows."""
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[: rows + 1]))


def raw(rows: int = 40, sessions: tuple[str, ...] = ("turn-1", "turn-2"), thrusters: int = 3) -> pl.DataFrame:
    """A plain raw table: `rows` rows at 50 Hz, shared evenly among `sessions`."""
    each = rows // len(sessions)
    rng = np.random.default_rng(7)
    columns: dict[str, Any] = {
        "session": np.repeat(sessions, each),
        "t": np.tile(np.arange(each) * 0.02, len(sessions)),
    }
    names = ["x", "y", "z", "phi", "theta", "psi", "u", "v", "w", "p", "q", "r"]
    names += [f"cmd_{i + 1}" for i in range(thrusters)]
    columns |= {name: rng.uniform(-0.9, 0.9, rows).astype(np.float32) for name in names}
    return pl.DataFrame(columns)


@st.composite
def tables(draw: st.DrawFn, kind: str) -> pl.DataFrame:
    """A table that keeps the schema of its kind, with float32 and float64 columns mixed."""
    rules = schema.load(kind)
    repeats = draw(st.integers(1, 4))
    names = [field.column(i + 1).name for field in rules.fields if field.repeat for i in range(repeats)]
    names += [field.name for field in rules.fields if field.optional and draw(st.booleans())]
    rows = draw(st.integers(1, 12))
    columns = rules.columns(names)
    others = sorted(columns.keys() - set(rules.primary_key))
    tricky = draw(st.sets(st.sampled_from(others), max_size=4))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    frame = {
        name: draw(_column(field, rows))
        if name in tricky or field.constraints.unique
        else _plain(field, draw(_few(field)), rows, rng)
        for name, field in columns.items()
    }
    if rules.series is not None:
        frame |= draw(_series(rules.series.key, rows))
    elif rules.primary_key:
        # One free text or number that differs from row to row makes the whole key differ.
        free = [name for name in rules.primary_key if _is_free_text(columns[name])]
        counted = [name for name in rules.primary_key if _is_free_number(columns[name])]
        if free:
            frame[free[0]] = pl.Series(draw(st.lists(texts, min_size=rows, max_size=rows, unique=True)))
        elif counted:
            numbers = st.lists(st.integers(0, 2**31), min_size=rows, max_size=rows, unique=True)
            frame[counted[-1]] = pl.Series(draw(numbers))
    return pl.DataFrame(frame)


def _is_free_text(field: Field) -> bool:
    rule = field.constraints
    return field.type == "string" and rule.enum is None and rule.pattern is None


def _is_free_number(field: Field) -> bool:
    return field.type == "integer" and field.constraints.maximum is None


@st.composite
def _series(draw: st.DrawFn, key: tuple[str, ...], rows: int) -> dict[str, pl.Series]:
    """Key columns of one to three recordings, each in one piece, and a time that increases in each."""
    count = min(rows, draw(st.integers(1, 3)))
    ends = [*sorted(draw(st.permutations(range(1, rows)))[: count - 1]), rows]
    lengths = np.diff([0, *ends])
    recordings = draw(st.lists(st.tuples(*[texts] * len(key)), min_size=count, max_size=count, unique=True))
    steps = draw(arrays(np.float64, rows, elements=st.floats(1e-3, 1.0)))
    start = draw(st.floats(-1e3, 2e9))
    time = np.concatenate(
        [start + np.cumsum(steps[end - n : end]) for n, end in zip(lengths, ends, strict=True)]
    )
    rows_of = [one for one, n in zip(recordings, lengths, strict=True) for _ in range(n)]  # numpy drops "\0"
    columns = {name: pl.Series([one[i] for one in rows_of]) for i, name in enumerate(key)}
    return columns | {"t": pl.Series(time)}


def _few(field: Field) -> st.SearchStrategy[pl.Series]:
    """One or two values of a column that is not of numbers; Hypothesis takes too long over every row."""
    return st.none() if field.type == "number" else st.integers(1, 2).flatmap(lambda n: _column(field, n))


def _plain(field: Field, few: pl.Series | None, rows: int, rng: np.random.Generator) -> pl.Series:
    """An ordinary column: drawn numbers, or `few` values again and again."""
    if few is not None:
        return few.gather(rng.integers(0, few.len(), rows))
    least, most = field.constraints.minimum, field.constraints.maximum
    low, high = -1e3 if least is None else least, 1e3 if most is None else most
    return pl.Series(rng.uniform(low, high, rows) * 0.999).cast(TYPES[str(rng.choice(field.arrow_type))])


def _column(field: Field, rows: int) -> st.SearchStrategy[pl.Series]:
    """A column that keeps the field's constraints."""
    rule = field.constraints
    if field.type == "string":
        if rule.enum is not None:
            values: st.SearchStrategy[str] = st.sampled_from(rule.enum)
        elif rule.pattern is not None:
            values = st.from_regex(rule.pattern, fullmatch=True)
        else:
            values = texts
        return st.lists(values, min_size=rows, max_size=rows, unique=rule.unique).map(
            lambda items: pl.Series(items, dtype=pl.String)
        )
    if field.type == "integer":
        most = 2**31 - 1 if rule.maximum is None else int(rule.maximum)
        integers = st.integers(int(rule.minimum or 0), most)
        return st.lists(integers, min_size=rows, max_size=rows).map(lambda v: pl.Series(v, dtype=pl.Int64))
    if field.type == "boolean":
        return st.lists(st.booleans(), min_size=rows, max_size=rows).map(pl.Series)
    if field.type == "array":
        return st.lists(_array(field), min_size=rows, max_size=rows).map(
            lambda v: pl.Series(v, dtype=pl.List(_inner(field)))
        )
    return st.sampled_from(field.arrow_type).flatmap(lambda width: _numbers(field, width, rows))


def _inner(field: Field) -> type[pl.DataType]:
    name = field.arrow_type[0]
    return pl.Int64 if "int" in name else pl.String if "string" in name else pl.Float32


def _array(field: Field) -> st.SearchStrategy[list[Any]]:
    if "string" in field.arrow_type[0]:
        return st.lists(texts, max_size=3)
    if "int" in field.arrow_type[0]:
        return st.lists(st.integers(0, 4), max_size=3)
    return st.lists(st.floats(-1e6, 1e6, width=32), max_size=5)


def _numbers(field: Field, width: str, rows: int) -> st.SearchStrategy[pl.Series]:
    rule = field.constraints
    low, high = rule.minimum, rule.maximum
    if width == "float32":  # a bound such as 1.5708 has no exact float32
        low = None if low is None else float(np.nextafter(np.float32(low), np.float32(0)))
        high = None if high is None else float(np.nextafter(np.float32(high), np.float32(0)))
    elements = st.floats(
        low, high, width=32 if width == "float32" else 64, allow_nan=False, allow_infinity=False
    )
    if not rule.required:
        optional = st.lists(st.none() | elements, min_size=rows, max_size=rows)
        return optional.map(lambda values: pl.Series(values, dtype=TYPES[width]))
    return arrays(width, rows, elements=elements).map(pl.Series)
