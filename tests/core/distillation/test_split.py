from __future__ import annotations

import hashlib
import struct

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.distillation.labels import filter_design
from hydro.core.distillation.split import CONTENT, block_bounds, split, split_from
from hydro.core.errors import DataError
from hydro.core.recording.smoothing import reach

COLUMNS = (*CONTENT, "cmd_1", "cmd_2")
BLOCK, REACH = 20, 4


def session(name: str, rows: int, seed: int, gap_at: int | None = None) -> pl.DataFrame:
    """Values that float32 holds exactly, so that storage can change without the data changing."""
    rng = np.random.default_rng(seed)
    values = {column: rng.normal(size=rows).astype(np.float32).astype(float) for column in COLUMNS}
    k = np.arange(rows)
    values["t"] = (k + (0 if gap_at is None else 10 * (k >= gap_at))) / 64
    return pl.DataFrame({"session": [name] * rows, **values})


def log(*rows: int) -> pl.DataFrame:
    return pl.concat([session(f"s{k}", count, k) for k, count in enumerate(rows)])


LOGS = st.lists(st.integers(8, 130), min_size=1, max_size=6)


def run(frame: pl.DataFrame, **options) -> pl.DataFrame:
    return split(frame, block=BLOCK, guard=options.pop("guard", REACH), **options)[0]


def test_an_id_is_the_hash_of_the_raw_values_and_the_salt():
    """Recomputed with struct and hashlib alone."""
    frame = session("any", 25, 5)
    content = b"".join(struct.pack(f"<{len(COLUMNS)}d", *row) for row in frame.select(COLUMNS).rows())
    made = split(frame, salt="salt é", guard=0)[0]
    expected = hashlib.sha256(content + "salt é".encode()).hexdigest()
    assert made["block"].unique().to_list() == [expected]
    below = int(expected, 16) / 2**256
    for share, part in ((below * 0.999, "train"), (below * 1.001, "test")):
        assert split(frame, salt="salt é", guard=0, test=share)[0]["part"].unique().to_list() == [part]


@given(st.lists(st.integers(1, 1000), min_size=1, max_size=5), st.integers(1, 200))
def test_blocks_have_their_length_and_the_last_the_remainder(lengths, block):
    edges = np.cumsum([0, *lengths])
    bounds = block_bounds(np.stack([edges[:-1], edges[1:]], axis=1), block)
    assert [start for start, _ in bounds.tolist()] == [0, *(stop for _, stop in bounds.tolist()[:-1])]
    ends = set(edges.tolist())
    for start, stop in bounds.tolist():
        if stop not in ends:
            assert stop - start == block
        elif start not in ends:
            assert block <= stop - start < 2 * block
        else:
            assert stop - start < 2 * block
    assert set(edges[1:].tolist()) <= {stop for _, stop in bounds.tolist()}


@given(LOGS, st.randoms(use_true_random=False))
def test_order_of_sessions_does_not_matter(rows, random):
    frame = log(*rows)
    parts = frame.partition_by("session", maintain_order=True)
    random.shuffle(parts)
    shuffled = run(pl.concat(parts))
    key = ["session", "t"]
    assert shuffled.sort(key).equals(run(frame).sort(key))


@given(LOGS, st.integers(8, 130))
def test_new_sessions_never_move_an_old_block(rows, more):
    frame = log(*rows)
    grown = run(pl.concat([session("new", more, 99), frame]))
    assert grown.filter(pl.col("session") != "new").equals(run(frame))


@given(LOGS, st.integers(1, 50))
def test_storage_does_not_matter(rows, chunk):
    """float32 or float64, in chunks of any size, -0 or 0, under any session name."""
    frame = log(*rows).with_columns(cmd_1=pl.lit(0.0))
    other = pl.concat([frame[k : k + chunk] for k in range(0, frame.height, chunk)], rechunk=False)
    other = other.with_columns(pl.col(pl.Float64).cast(pl.Float32), session="renamed " + pl.col("session"))
    other = other.with_columns(cmd_1=pl.lit(-0.0))
    for column in ("block", "part"):
        assert run(other)[column].equals(run(frame)[column])


@given(LOGS, st.integers(0, 60), st.floats(0.2, 0.8))
def test_guard_rows_are_those_near_the_other_side(rows, guard, share):
    frame = log(*rows)
    bare = run(frame, guard=0, test=share)
    part, name = bare["part"].to_list(), bare["session"].to_list()
    expected = list(part)
    for k in range(frame.height):
        near = range(max(k - guard, 0), min(k + guard + 1, frame.height))
        if any(part[j] != part[k] and name[j] == name[k] for j in near):
            expected[k] = "guard"
    if set(part) <= set(expected):
        assert run(frame, guard=guard, test=share)["part"].to_list() == expected
    else:
        with pytest.raises(DataError, match="use longer blocks"):
            run(frame, guard=guard, test=share)


def test_a_gap_ends_a_block_and_needs_no_guard():
    frame = session("s", 100, 3, gap_at=30)
    made = run(frame, guard=0)
    assert made.select(pl.col("block").rle()).unnest("block")["len"].to_list() == [30, 20, 20, 30]
    sides = ["train"] + ["test"] * 3
    blocks = pl.DataFrame({"block": made["block"].unique(maintain_order=True), "part": sides})
    apart, _ = split_from(frame, blocks, block=BLOCK, guard=25)
    assert apart["part"].to_list() == ["train"] * 30 + ["test"] * 70


def test_shares_and_table():
    frame = log(*[400] * 60)
    made, blocks = split(frame, block=BLOCK, guard=0)
    assert blocks.columns == ["block", "part"]
    assert blocks.height == 60 * 20
    assert (blocks["part"] == "test").mean() == pytest.approx(0.2, abs=0.03)
    assert (
        made.join(blocks, on="block", suffix="_of_block")
        .select((pl.col("part") == pl.col("part_of_block")).all())
        .item()
    )
    assert blocks["block"].is_sorted()
    for share, part in ((0.0, "train"), (1.0, "test")):
        assert split(frame, block=BLOCK, test=share)[0]["part"].unique().to_list() == [part]


def test_a_larger_share_keeps_the_test_blocks_it_had():
    frame = log(*[300] * 8)
    small, large = (run(frame, test=share, guard=0)["part"] == "test" for share in (0.2, 0.5))
    assert (small & ~large).sum() == 0
    assert large.sum() > small.sum()


def test_another_salt_is_another_split():
    frame = log(*[300] * 8)
    assert run(frame)["part"].to_list() != run(frame, salt="1")["part"].to_list()


def test_twins_stand_on_one_side():
    twin = session("a", 130, 1)
    frame = pl.concat([twin, twin.with_columns(session=pl.lit("b"))])
    made, blocks = split(frame, block=BLOCK, guard=0, test=0.5)
    assert made["part"][:130].equals(made["part"][130:])
    assert blocks.height == 6


def test_guard_defaults_to_the_reach_of_the_smoother():
    t = np.arange(4000) * 0.02
    rng = np.random.default_rng(0)
    clean = {name: np.sin(t * (k + 1) / 3) for k, name in enumerate("uvwpqr")}
    frame = session("s", 4000, 0).with_columns(t=pl.Series(t), **{k: pl.Series(v) for k, v in clean.items()})
    noisy = frame.with_columns(**{k: pl.Series(v + 0.05 * rng.normal(size=4000)) for k, v in clean.items()})
    rows = [reach(filter_design(data)) for data in (frame, noisy)]
    assert rows[0] < 8 < 30 < rows[1]
    for data, guard in zip((frame, noisy), rows, strict=True):
        assert split(data, block=1000)[0].equals(split(data, block=1000, guard=guard)[0])


def test_a_guard_that_leaves_nothing():
    frame = log(*[100] * 5)
    assert (run(frame, guard=19, test=0.5)["part"] != "guard").any()
    with pytest.raises(DataError, match="a guard of 100 rows leaves no test rows; use longer blocks"):
        run(log(*[400] * 5), guard=100)


@given(LOGS, st.floats(0.1, 0.9))
def test_split_from_its_own_blocks(rows, share):
    frame = log(*rows)
    made, blocks = split(frame, block=BLOCK, test=share, salt="x", guard=REACH)
    again, same = split_from(frame.reverse().sort("session", "t"), blocks, block=BLOCK, salt="x", guard=REACH)
    assert again.equals(made)
    assert same.equals(blocks)


def test_split_from_other_blocks():
    frame = log(100, 60)
    _, blocks = split(frame, block=BLOCK, guard=0)
    moved = blocks.with_columns(part=pl.lit("test"))
    assert split_from(frame, moved, block=BLOCK)[0]["part"].unique().to_list() == ["test"]
    part_only = split_from(frame[100:], blocks, block=BLOCK, guard=0)
    assert part_only[0].equals(split(frame[100:], block=BLOCK, guard=0)[0])
    for wrong in ({"block": BLOCK + 1}, {"block": BLOCK, "salt": "other"}):
        with pytest.raises(
            DataError, match=r"blocks are not in the table of blocks \(first: row 0, session s0\)"
        ):
            split_from(frame, blocks, **wrong)


def test_bad_arguments():
    with pytest.raises(DataError, match="test share must lie within 0 and 1"):
        split(log(30), test=1.5)
    with pytest.raises(DataError, match="at least one row, not 0"):
        split(log(30), block=0)


def test_stonefish_blocks(stonefish):
    """About 5,700 blocks, a fifth of them test data, and few rows lost to the guard."""
    made, blocks = split(pl.read_parquet(stonefish / "nominal.parquet"))
    assert 5600 < blocks.height < 5720
    assert (blocks["part"] == "test").mean() == pytest.approx(0.2, abs=0.02)
    assert 0.005 < (made["part"] == "guard").mean() < 0.05
