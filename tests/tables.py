"""Sound tables for tests: plain recordings, long ones cut short, strategies made from the schema files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hydro.io import schema, table
from hydro.io.schema_field import Constraints, Field

TYPES = {
    "float32": pl.Float32,
    "float64": pl.Float64,
    "int32": pl.Int32,
    "int64": pl.Int64,
    "string": pl.String,
}
texts = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=12)
TEXTS = (
    *("a", "turn-1", "NaN", "null", "-1.5", " ", "a b", "\0", "a\0b", "\n", "\t\r\n", '"', "'", "\\", ",;|"),
    *(
        "ü",
        "e\u0301",
        "\ufeff",
        "\u202e",
        "\uffff",
        "深海",
        "🤿",
        "\U0010ffff",
        "\x7f",
        "%s",
        "{n}",
        "x" * 300,
    ),
)
"""Texts that files, shells and encodings have trouble with, for columns that Hypothesis does not draw."""
HUGE, TINY = 3e38, 1e-45  # close to the greatest and the least float32


def shorten(folder: Path, seconds: float, sessions: int | None = None, names: str = "*") -> None:
    """Cut every session of recordings in a folder to its beginning; keep all or the first `sessions`."""
    for path in folder.glob(f"{names}.parquet"):
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
    tricky = draw(st.sets(st.sampled_from(others), max_size=2))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    frame = {}
    for name, field in columns.items():
        if name in tricky or field.constraints.unique:
            frame[name] = draw(_column(field, rows))
        elif field.constraints.pattern is not None:
            frame[name] = draw(_column(field, 1)).gather([0] * rows)
        else:
            frame[name] = _plain(field, rows, rng)
    if rules.series is not None:
        frame |= draw(_series(rules.series.key, rows))
    elif rules.primary_key:
        # One free text or number that differs from row to row makes the whole key differ.
        free = [name for name in rules.primary_key if _is_free_text(columns[name])]
        counted = [name for name in rules.primary_key if _is_free_number(columns[name])]
        if free:
            frame[free[0]] = pl.Series([f"{text}{row}" for row, text in enumerate(rng.choice(TEXTS, rows))])
        elif counted:
            some = np.unique(np.r_[0, 2**31, rng.integers(1, 2**31, 98)])
            frame[counted[-1]] = pl.Series(rng.permutation(some)[:rows])
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


def _plain(field: Field, rows: int, rng: np.random.Generator) -> pl.Series:
    """A column with values that a seed chooses: Hypothesis takes too long over every cell."""
    rule = field.constraints

    def chosen(values: Sequence[Any], count: int) -> list[Any]:
        return [values[i] for i in rng.integers(0, len(values), count)]

    if field.type == "string":
        return pl.Series(chosen(rule.enum or TEXTS, rows), dtype=pl.String)
    if field.type == "integer":
        least, most = int(rule.minimum or 0), 2**31 - 1 if rule.maximum is None else int(rule.maximum)
        some = (least, most, *rng.integers(least, most + 1, 3).tolist())
        return pl.Series(chosen(some, rows), dtype=pl.Int64)
    if field.type == "boolean":
        return pl.Series(chosen((False, True), rows))
    if field.type == "array":
        texts_, counts = "string" in field.arrow_type[0], "int" in field.arrow_type[0]
        pool = TEXTS if texts_ else (0, 1, 4) if counts else (0.0, -0.0, 1.0, -1e6, TINY)
        return pl.Series([chosen(pool, n) for n in rng.integers(0, 4, rows)], dtype=pl.List(_inner(field)))
    low = -1e3 if rule.minimum is None else rule.minimum
    high = 1e3 if rule.maximum is None else rule.maximum
    edge = 1e-3 * (high - low)  # a bound itself may have no exact float32
    low, high = low + edge, high - edge
    special = [low, high, *(x for x in (0.0, -0.0, TINY, HUGE, -HUGE) if _within(rule, x))]
    numbers = np.where(rng.random(rows) < 0.3, chosen(special, rows), rng.uniform(low, high, rows))
    return pl.Series(numbers).cast(TYPES[str(rng.choice(field.arrow_type))])


def _within(rule: Constraints, number: float) -> bool:
    """Whether a number keeps the bounds of a column."""
    least, most = rule.minimum, rule.maximum
    return (least is None or number >= least) and (most is None or number <= most)


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
        low = None if low is None else float(np.nextafter(np.float32(low), np.float32(np.inf)))
        high = None if high is None else float(np.nextafter(np.float32(high), np.float32(-np.inf)))
    elements = st.floats(
        low, high, width=32 if width == "float32" else 64, allow_nan=False, allow_infinity=False
    )
    if not rule.required:
        optional = st.lists(st.none() | elements, min_size=rows, max_size=rows)
        return optional.map(lambda values: pl.Series(values, dtype=TYPES[width]))
    return arrays(width, rows, elements=elements).map(pl.Series)
