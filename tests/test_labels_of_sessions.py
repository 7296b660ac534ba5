"""`hydro labels` of a folder of sessions: what one table would have, session by session, and as cheap."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest
import recordings

from hydro import cli
from hydro.commands.shell import noise_for
from hydro.core.distillation.labels import filter_design, filter_design_of_sessions
from hydro.core.recording.segments import clock
from hydro.io import partitions, table
from hydro.io.files import bundled

VEHICLE = str(bundled("vehicles") / "auv151.toml")


def sessions(*names: str, noise: bool, rows: int = 400) -> pl.DataFrame:
    """Sessions of a simulated vehicle, with the noise of a DVL or without."""
    parts = []
    for number, name in enumerate(names):
        frame = recordings.moved(recordings.damped(), seed=number, rows=rows)
        frame = recordings.noisy(frame, number) if noise else frame
        parts.append(frame.with_columns(session=pl.lit(name)))
    return pl.concat(parts)


def write(folder: Path, frame: pl.DataFrame) -> Path:
    for (name,), part in frame.group_by("session", maintain_order=True):
        target = partitions.place(folder, str(name))
        target.parent.mkdir(parents=True, exist_ok=True)
        table.write(table.make("raw", part, stage="import"), target)
    return folder


def run(*line: object) -> int:
    return cli.main(["labels", *map(str, line), "--vehicle", VEHICLE])


def content(folder: Path) -> dict[str, bytes]:
    return {
        session: partitions.place(folder, session).read_bytes() for session in partitions.sessions(folder)
    }


def test_a_folder_has_the_labels_of_one_table(tmp_path):
    raw = sessions("a", "b", "c", noise=True)
    table.write(table.make("raw", raw, stage="import"), tmp_path / "raw.parquet")
    assert run(tmp_path / "raw.parquet", "-o", tmp_path / "labels.parquet") == 0
    assert run(write(tmp_path / "dives", raw), "-o", tmp_path / "labels") == 0
    one, many = table.read(tmp_path / "labels.parquet"), table.read(tmp_path / "labels")
    assert many.frame.equals(one.frame)
    assert not list((tmp_path / "labels").glob(".*")), "nothing else is left there"


def test_the_filter_of_sessions_is_that_of_one_table_whatever_is_read_of_them():
    raw = sessions("a", "b", "c", noise=True, rows=3000)
    parts = {str(name): part for (name,), part in raw.group_by("session", maintain_order=True)}
    gapped = parts["b"].filter(~pl.col("t").is_between(11.0, 13.0))
    parts["b"], read = gapped, list[str]()

    def velocity(session: str) -> pl.DataFrame:
        read.append(session)
        return parts[session].select("u", "v", "w", "p", "q", "r")

    found = filter_design_of_sessions({name: clock(part) for name, part in parts.items()}, velocity)
    assert found == filter_design(pl.concat(parts.values()))
    assert read == ["a", "b", "c"]


@pytest.mark.parametrize("noise", [False, True], ids=["free of noise", "noisy"])
def test_a_session_free_of_noise_has_the_same_labels_whatever_others_there_are(tmp_path, noise):
    """Of a noisy log all sessions tell of its noise: the filter is that of the whole, as in one table."""
    raw = sessions("a", "b", "c", noise=noise)
    quiet = raw.with_columns(pl.when(pl.col("session") == "a").then("u").otherwise(pl.col("u") * 1.01))
    write(tmp_path / "one", quiet.filter(pl.col("session") == "a"))
    write(tmp_path / "many", quiet)
    for name in ("one", "many"):
        assert run(tmp_path / name, "-o", tmp_path / f"{name}-labels") == 0
    same = content(tmp_path / "one-labels")["a"] == content(tmp_path / "many-labels")["a"]
    assert same is not noise


def test_the_footer_says_which_filter_was_shared(tmp_path):
    raw = sessions("a", "b", noise=True)
    assert run(write(tmp_path / "dives", raw), "--noise", "ordinary", "-o", tmp_path / "labels") == 0
    given = noise_for("ordinary")
    design = filter_design(raw, [given.velocity] * 3 + [given.rate] * 3)
    shared = table.read(tmp_path / "labels").provenance.parameters["filter"]
    assert shared == {"dt": design.dt, "ratio": list(design.ratio)}


def test_sessions_with_nulls_are_labelled_by_their_samples_and_so_are_the_others(tmp_path):
    raw = sessions("a", "b", noise=True)
    rare = (pl.int_range(pl.len()) % 5 == 0) | (pl.col("session") == "a")
    raw = raw.with_columns(pl.when(rare).then(pl.col(name)).alias(name) for name in ("u", "v", "w"))
    assert run(write(tmp_path / "dives", raw), "-o", tmp_path / "labels") == 0
    labels = partitions.opened(tmp_path / "labels", ("labels",))
    assert "u_dot_sd" in labels.parts[0].columns
    assert run(tmp_path / "dives", "--acceleration", "kalman", "-o", tmp_path / "others") == 1


def test_sessions_at_two_rates_are_refused(tmp_path, capsys):
    raw = sessions("a", "b", "c", noise=False)
    slow = raw.with_columns(pl.when(pl.col("session") == "b").then(pl.col("t") * 2.0).otherwise("t"))
    assert run(write(tmp_path / "dives", slow), "-o", tmp_path / "labels") == 1
    assert "1 of 3 sessions are not sampled every 0.02 s (first: b, every 0.04 s)" in capsys.readouterr().err


def test_what_is_wrong_with_a_session_names_its_file(tmp_path, capsys):
    raw = sessions("a", "b", noise=False)
    odd = pl.when((pl.col("session") == "b") & (pl.int_range(pl.len()) % 400 == 7)).then(0.005).otherwise(0.0)
    assert run(write(tmp_path / "dives", raw.with_columns(pl.col("t") + odd)), "-o", tmp_path / "labels") == 1
    told = capsys.readouterr().err
    assert told.startswith(f"hydro: {partitions.place(tmp_path / 'dives', 'b')}: t [s] must step by 0.02 s")
    assert told.count("\n") == 1


def test_where_labels_of_a_folder_go(tmp_path, capsys):
    dives = write(tmp_path / "dives", sessions("a", "b", noise=False))
    (tmp_path / "file").write_text("")
    refused = {
        (str(dives),): "add -o FOLDER",
        (str(dives), "-o", str(dives)): "this is the input",
        (str(dives), "-o", str(tmp_path / "file")): "a file, not a folder",
        (str(dives), str(tmp_path / "file"), "-o", str(tmp_path / "labels")): "give the folder alone",
    }
    for line, words in refused.items():
        assert run(*line) in (1, 2)
        assert words in capsys.readouterr().err
    write(tmp_path / "labels", sessions("z", noise=False))
    assert run(dives, "-o", tmp_path / "labels") == 0
    assert "earlier sessions stay in this folder: z" in capsys.readouterr().err


def test_a_table_becomes_a_folder_of_its_sessions_and_grows_by_others(tmp_path, capsys):
    raw, folder = sessions("a", "b/1", noise=False), tmp_path / "dives"
    table.write(table.make("raw", raw, stage="import"), tmp_path / "raw.parquet")
    table.write(table.make("raw", sessions("c", noise=False), stage="import"), tmp_path / "more.parquet")
    table.write(table.make("raw", sessions("z", "a", noise=False), stage="import"), tmp_path / "no.parquet")
    for name in ("raw", "raw", "more"):
        assert cli.main(["partition", str(tmp_path / f"{name}.parquet"), "-o", str(folder)]) == 0
    whole = table.read(folder, "raw")
    assert whole.frame.head(raw.height).equals(table.conform("raw", raw))
    assert {one.content for one in whole.provenance.inputs} == {
        table.read(tmp_path / f"{name}.parquet").provenance.content for name in ("raw", "more")
    }
    assert "2 sessions, 2 in all" in capsys.readouterr().err
    assert cli.main(["partition", str(tmp_path / "no.parquet"), "-o", str(folder)]) == 1
    assert "has another session a already" in capsys.readouterr().err
    assert partitions.sessions(folder) == ["a", "b/1", "c"]


def test_other_commands_read_a_folder_as_one_recording(tmp_path):
    raw = sessions("a", "b", noise=True)
    assert run(write(tmp_path / "dives", raw), "-o", tmp_path / "labels") == 0
    assert cli.main(["split", str(tmp_path / "labels"), "-o", str(tmp_path / "split.parquet")]) == 0
    assert table.read(tmp_path / "split.parquet").frame.height == raw.height
    assert cli.main(["check", str(tmp_path / "dives"), str(tmp_path / "labels")]) == 0
    np.testing.assert_array_equal(table.read(tmp_path / "dives").frame["u"], raw["u"])
    partitions.place(tmp_path / "dives", "b").write_bytes(b"PAR1")
    assert cli.main(["check", str(tmp_path / "dives")]) == 1


def test_the_query_of_the_page_reads_a_folder(tmp_path, monkeypatch):
    raw = sessions("monday-1", "monday-2", "tuesday", noise=False)
    assert run(write(tmp_path / "dives", raw), "-o", tmp_path / "labels") == 0
    text = (Path(__file__).resolve().parents[1] / "docs" / "scale.md").read_text()
    query = text.split("```python\n")[1].split("```")[0]
    monkeypatch.chdir(tmp_path)
    found: dict[str, pl.DataFrame] = {}
    exec(query, found)
    labels = table.read(tmp_path / "labels").frame
    fastest = labels.filter(pl.col("session") == "monday-2")["u"].abs().max()
    assert found["surge"].select("session", "fastest").row(1) == ("monday-2", fastest)
    assert found["surge"].height == 2
