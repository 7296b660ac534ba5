"""The work of a command on a Ray cluster of two nodes: the same bytes, also where a node goes on the way."""

from __future__ import annotations

import argparse
import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import polars as pl
import pytest
import recordings

from benchmarks import nodes as two
from benchmarks.work import add_workers, done
from hydro import cli
from hydro.core.errors import DataError, UsageError
from hydro.io import partitions, table
from hydro.io import vehicle as vehicles
from hydro.io.files import bundled
from hydro.study import cluster as module
from hydro.study.cluster import Cluster
from hydro.study.steps import Runner, Step, StepFailed

pytest.importorskip("ray", reason="Ray is not installed: pip install 'deep-hydro-sim[ray]'")
pytestmark = pytest.mark.skipif(os.uname().sysname != "Linux", reason="127.0.0.2 answers on Linux alone")

VEHICLE = str(bundled("vehicles") / "auv151.toml")
NAMES = ("a", "b", "c", "d")


@pytest.fixture(scope="module")
def nodes() -> Iterator[two.Nodes]:
    with two.nodes() as found:
        yield found


@pytest.fixture(scope="module")
def cluster(nodes: two.Nodes) -> Iterator[Cluster]:
    """One connection for all tests but the first: Ray starts new workers for every connection."""
    nodes.wait()
    with Cluster(nodes.address) as connected:
        connected.prepare()
        yield connected


class Connected:
    """The Ray module, of which a connection is there already and stays."""

    def __init__(self, ray: Any) -> None:
        self.ray = ray

    def __getattr__(self, name: str) -> Any:
        return getattr(self.ray, name)

    def init(self, **options: Any) -> None:
        """Check that a command asks for what the connection has."""
        assert options["runtime_env"]["env_vars"]["OMP_NUM_THREADS"] == "1"

    def shutdown(self) -> None:
        """Leave the connection open."""


@pytest.fixture
def connected(nodes: two.Nodes, cluster: Cluster, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Options of commands that work on the cluster through the connection that is there."""
    import ray

    monkeypatch.setattr(module, "_imported", lambda: Connected(ray))
    return ["--engine", "ray", "--address", nodes.address]


@pytest.fixture(scope="module")
def dives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dives")
    for number, name in enumerate(NAMES):
        frame = recordings.noisy(recordings.moved(recordings.damped(), seed=number, rows=600), number)
        target = partitions.place(folder, name)
        target.parent.mkdir()
        table.write(table.make("raw", frame.with_columns(session=pl.lit(name)), stage="import"), target)
    return folder


def content(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*.parquet")}


def test_labels_of_a_cluster_are_those_of_one_process(nodes, dives, tmp_path):
    """The command makes its own connection, before this process has another."""
    line = ["labels", str(dives), "--vehicle", VEHICLE]
    assert cli.main([*line, "-o", str(tmp_path / "here")]) == 0
    ray = ["--engine", "ray", "--address", nodes.address]
    assert cli.main([*line, *ray, "-o", str(tmp_path / "there")]) == 0
    assert content(tmp_path / "there") == content(tmp_path / "here")
    assert len(content(tmp_path / "here")) == len(NAMES)


def test_diagnoses_of_a_cluster_are_those_of_one_process(connected, dives, tmp_path, capfd):
    """Session by session as a file of its own; one that is too short holds nobody up."""
    few, vehicle = tmp_path / "few", vehicles.read(VEHICLE)[0]
    for name in ("a", "short"):
        target = partitions.place(few, name)
        target.parent.mkdir(parents=True)
        rows = recordings.moved(vehicle, seed=1, rows=1650).head(1650 if name == "a" else 12)
        made = table.make("raw", rows.with_columns(session=pl.lit(name)), stage="import")
        table.write(made, target)
    alone = tmp_path / "a.parquet"
    assert cli.main(["diagnose", VEHICLE, str(partitions.place(few, "a")), "-o", str(alone)]) == 0
    assert cli.main(["diagnose", VEHICLE, str(few), "--each", *connected, "-o", str(tmp_path / "each")]) == 1
    assert partitions.place(tmp_path / "each", "a").read_bytes() == alone.read_bytes()
    told = capfd.readouterr().err
    assert f"hydro: {partitions.place(few, 'short')}: " in told
    assert "1 of 2 sessions could not be diagnosed, see above" in told
    assert partitions.sessions(tmp_path / "each") == ["a"]


def test_a_history_of_a_cluster_is_that_of_one_process(connected, dives, tmp_path):
    """Table, estimates of each dive, changes and page, and a second run that reads them all."""
    line = ["track", VEHICLE, str(dives), "--baseline", "2"]
    assert cli.main([*line, "-o", str(tmp_path / "here")]) == 0
    assert cli.main([*line, *connected, "-o", str(tmp_path / "there")]) == 0
    here, there = (
        {path.relative_to(tmp_path / home): path.read_bytes() for path in (tmp_path / home).rglob("*.*")}
        for home in ("here", "there")
    )
    assert there == here
    assert len(content(tmp_path / "here")) == 1 + len(NAMES)


def slow_copy(source: Path, folder: Path) -> str:
    """A task that leaves a mark where it began, takes its time and writes a file; the node it ran on."""
    import ray

    from hydro.io.files import write_bytes

    node = str(ray.util.get_node_ip_address())
    (folder / f"{source.parent.name}.{node}.begun").touch()
    time.sleep(1.0)
    write_bytes(source.read_bytes(), folder / f"{source.parent.name}.parquet")
    return node


def threads(_: int) -> tuple[int, str]:
    from hydro.core.threads import available

    return available(), os.environ["OMP_NUM_THREADS"]


def failing(number: int) -> int:
    if number == 2:
        raise DataError("the third is at fault")
    return number


def test_benchmarks_run_their_tasks_on_the_cluster(connected):
    parser = argparse.ArgumentParser()
    add_workers(parser)
    chosen = parser.parse_args(connected)
    assert sorted(done(abs, [(-1,), (2,), (-3,)], chosen)) == [1, 2, 3]


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("nowhere", "give HOST:PORT"),
        ("127.0.0.2:99999", "give HOST:PORT"),
        ("127.0.0.2:9", "cannot be reached (Connection refused)"),
        ("ray://127.0.0.2:9", "cannot be reached (Connection refused)"),
    ],
)
def test_a_wrong_address_is_one_line_at_once(dives, tmp_path, capsys, address, words):
    line = ["labels", str(dives), "--vehicle", VEHICLE, "-o", str(tmp_path / "labels")]
    assert cli.main([*line, "--engine", "ray", "--address", address]) == 2
    told = capsys.readouterr().err
    assert words in told
    assert told.count("\n") == 1


def test_what_is_no_ray_head_is_told_apart(tmp_path, monkeypatch):
    import socket

    monkeypatch.setattr(module, "PATIENCE", 0.2)
    with socket.socket() as deaf:
        deaf.bind((two.HEAD, 0))
        deaf.listen()
        with pytest.raises(UsageError, match="not a Ray head"):
            Cluster(f"{two.HEAD}:{deaf.getsockname()[1]}")


def test_without_ray_one_line_says_what_to_install(dives, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "ray", None)
    line = ["labels", str(dives), "--vehicle", VEHICLE, "-o", str(tmp_path / "labels"), "--engine", "ray"]
    assert cli.main(line) == 2
    assert capsys.readouterr().err == "hydro: --engine ray needs Ray: pip install 'deep-hydro-sim[ray]'\n"


def test_a_cluster_is_refused_where_there_is_nothing_to_share_out(dives, tmp_path, capsys):
    part = str(partitions.place(dives, "a"))
    refused = {
        ("labels", part, "--engine", "ray", "-o", str(tmp_path / "x.parquet")): "give a folder of them",
        ("labels", str(dives), "--address", "a:1", "-o", str(tmp_path / "y")): "add --engine ray",
        ("diagnose", VEHICLE, part, "--engine", "ray"): "add --each",
        (
            "diagnose",
            VEHICLE,
            part,
            "--each",
            "-o",
            str(tmp_path / "z.parquet"),
        ): "needs a folder of sessions",
        ("diagnose", VEHICLE, str(dives), "--each"): "needs a folder of sessions",
        ("diagnose", VEHICLE, str(dives), "--each", "--discover", "-o", str(tmp_path)): "without --discover",
    }
    for line, words in refused.items():
        assert cli.main(list(line)) == 2
        assert words in capsys.readouterr().err


def test_both_nodes_work_each_with_the_threads_it_was_given(cluster):
    assert cluster.slots == 2
    assert set(cluster.each(threads, [(1,), (2,)])) == {(1, "1")}
    found = cluster.each(failing, [(number,) for number in range(4)])
    assert [next(found), next(found)] == [0, 1]
    with pytest.raises(DataError, match=r"^the third is at fault$"):
        next(found)


def test_a_study_runs_its_steps_on_the_cluster(cluster, dives, tmp_path, capsys):
    raw = partitions.place(dives, "a")
    made = {
        home: [tmp_path / home / name for name in ("labels.parquet", "split.parquet")] for home in ("h", "t")
    }
    steps = {
        home: [
            Step(("labels", str(raw), "--vehicle", VEHICLE, "-o", str(labels)), (raw,), (labels,)),
            Step(("split", str(labels), "-o", str(split)), (labels,), (split,)),
        ]
        for home, (labels, split) in made.items()
    }
    bad = Step(("check", str(tmp_path / "none.toml")), (), (tmp_path / "x",))
    assert Runner(tmp_path, cluster.execute).run(steps["t"], cluster.slots) == 2
    with pytest.raises(StepFailed) as failed:
        cluster.execute(bad)
    assert failed.value.exit_code == 1
    assert "none.toml: no such file" in capsys.readouterr().err
    for step in steps["h"]:
        step.writes[0].parent.mkdir(exist_ok=True)
        assert cli.main(list(step.line)) == 0
    assert [path.read_bytes() for path in made["t"]] == [path.read_bytes() for path in made["h"]]


def test_a_node_that_is_killed_on_the_way_costs_time_and_nothing_else(nodes, cluster, dives, tmp_path):
    """The last of this module: the second node is gone afterwards."""
    marks = f"*.{two.SECOND}.begun"

    def kill() -> None:
        while not list(tmp_path.glob(marks)):
            time.sleep(0.05)
        nodes.kill(two.SECOND)

    killer = threading.Thread(target=kill, daemon=True)
    killer.start()
    sources = [partitions.place(dives, name) for name in NAMES]
    on = list(cluster.each(slow_copy, [(source, tmp_path) for source in sources]))
    killer.join()
    assert list(tmp_path.glob(marks)), "it had begun there"
    assert on.count(two.HEAD) >= 3
    for source in sources:
        assert (tmp_path / f"{source.parent.name}.parquet").read_bytes() == source.read_bytes()
