"""The bundled recordings are what their README says they are."""

from __future__ import annotations

import hashlib
import re
import tomllib
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from hydro.core import effects
from hydro.core.recording.segments import sample_time, segments
from hydro.io import table, vehicle

TABLES = ("sample", "replay90")
FOLDERS = ("stonefish", "hidden", "changed")
RECORDINGS = ("stonefish/sample", "stonefish/replay90", "hidden/measured", "hidden/heldout")


def listed(datasets: Path, pattern: str) -> dict[str, str]:
    """Hashes in the README by file."""
    text = (datasets / "README.md").read_text()
    return {
        name: digest
        for digest, name in re.findall(rf"^({pattern}[0-9a-f]{{64}})  (\S+)$", text, re.MULTILINE)
    }


CHANGED = {"before": 12, "thruster": 7, "thruster-heldout": 2, "current": 9, "current-heldout": 2}
"""Excerpts of changed and unchanged vehicles, with their numbers of sessions."""


def test_files_have_the_hashes_of_the_readme(datasets: Path) -> None:
    files = {f"{folder}/{path.name}": path for folder in FOLDERS for path in (datasets / folder).iterdir()}
    digests = {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in files.items()}
    assert digests == listed(datasets, "")


@pytest.mark.parametrize("name", RECORDINGS)
def test_tables_carry_their_content_hash_and_their_vehicle(datasets: Path, name: str) -> None:
    artefact = table.read(datasets / f"{name}.parquet", "raw")
    assert artefact.provenance.content == listed(datasets, "sha256:")[f"{name}.parquet"]
    known, text = vehicle.read(datasets / Path(name).parent / "vehicle.toml")
    assert artefact.provenance.vehicle == text
    assert [source.content for source in artefact.provenance.inputs] == [vehicle.vehicle_hash(known)]


def test_rows_and_sessions(datasets: Path) -> None:
    sample, replay = (table.read(datasets / "stonefish" / f"{name}.parquet").frame for name in TABLES)
    assert (sample.height, sample["session"].n_unique()) == (59_914, 58)
    assert (replay.height, replay["session"].n_unique()) == (4_500, 1)
    for frame in (sample, replay):
        assert sample_time(frame) == pytest.approx(0.02)
        assert len(segments(frame)) == frame["session"].n_unique(), "a session without gaps"
        assert "cmd_8" in frame.columns


def hidden(datasets: Path) -> tuple[pl.DataFrame, pl.DataFrame]:
    return tuple(
        table.read(datasets / "hidden" / f"{name}.parquet").frame for name in ("measured", "heldout")
    )


def test_the_recordings_with_hidden_effects(datasets: Path) -> None:
    measured, heldout = hidden(datasets)
    assert (measured.height, measured["session"].n_unique()) == (12_000, 4)
    assert (heldout.height, heldout["session"].n_unique()) == (4_500, 2)
    assert not set(measured["session"]) & set(heldout["session"])
    for frame in (measured, heldout):
        assert sample_time(frame) == pytest.approx(0.02)
        assert frame["u"].dtype == pl.Float32
    assert sum(path.stat().st_size for path in (datasets / "hidden").iterdir()) < 2_500_000


@pytest.mark.parametrize("name", CHANGED)
def test_the_excerpts_begin_with_rotors_at_rest_and_carry_their_origin(datasets: Path, name: str) -> None:
    artefact = table.read(datasets / "changed" / f"{name}.parquet", "raw")
    assert artefact.provenance.content == listed(datasets, "sha256:")[f"changed/{name}.parquet"]
    assert artefact.provenance.vehicle == (datasets / "stonefish" / "vehicle.toml").read_text()
    assert artefact.provenance.parameters["simulator"] == "Stonefish 1.6.0"
    first = artefact.frame.group_by("session").first()
    assert first.height == CHANGED[name]
    assert (first["t"] == 0.0).all()
    assert first.select(pl.col("u", "v", "w", "p", "q", "r").abs().max()).to_numpy().max() == 0.0


def test_the_file_of_the_unchanged_vehicle_was_fitted_to_the_bundled_recording(datasets: Path) -> None:
    known, _ = vehicle.read(datasets / "changed" / "vehicle.toml")
    fitted = {str(one["name"]): one["fit"]["data"] for one in known.effect if "fit" in one}
    assert set(fitted) == {"power_drag", "cross_axis_drag", "offset_drag"}
    assert set(fitted.values()) == {listed(datasets, "sha256:")["changed/before.parquet"]}
    assert sum(path.stat().st_size for path in (datasets / "changed").iterdir()) < 3_000_000


def test_the_truth_made_the_recordings_and_stands_nowhere_else(datasets: Path) -> None:
    """The vehicle with the truth moves as recorded, but for noise; the vehicle file does not name it."""
    from hydro.core.diagnosis.findings import extended
    from hydro.core.simulation.simulate import simulate

    truth = tomllib.loads((datasets / "hidden" / "truth.toml").read_text())
    known, text = vehicle.read(datasets / "hidden" / "vehicle.toml")
    names = [effect["name"] for effect in truth["effect"]]
    assert names == ["ocean_current", "thruster_gain", "quadratic_damping"]
    assert not [name for name in names[:2] if name in text]
    assert known.effects("quadratic_damping")[0]["diagonal"] != truth["effect"][2]["diagonal"]
    for name, frame in zip(("measured", "heldout"), hidden(datasets), strict=True):
        record = table.read(datasets / "hidden" / f"{name}.parquet").provenance
        assert truth["raw"][name] == record.content
        assert "ocean" not in str(record)
        start = frame.cast({pl.Float32: pl.Float64}).with_columns(pl.col(*"uvwpqr").cast(pl.Float64) * 0.0)
        moved = simulate(extended(known, truth["effect"]), start).group_by("session").head(100)
        logged = frame.group_by("session").head(100)
        error = (
            moved.sort("session", "t").select(*"uvw") - logged.sort("session", "t").select(*"uvw")
        ).to_numpy()
        assert error.std() == pytest.approx(0.01, rel=0.15)


def test_no_module_reads_the_truth() -> None:
    sources = [path.read_text() for path in (Path(__file__).parents[1] / "hydro").rglob("*.py")]
    assert not [text for text in sources if "truth.toml" in text]


@pytest.mark.parametrize("name", TABLES)
def test_pose_and_velocity_agree_in_frame_and_sign(datasets: Path, name: str) -> None:
    """The world velocity R(phi, theta, psi) (u, v, w) is the pose's derivative, by central differences."""
    from hydro.core.vehicle.frames import rotation

    frame = table.read(datasets / "stonefish" / f"{name}.parquet").frame
    one = frame.filter(pl.col("session") == frame["session"][0]).cast({pl.Float32: pl.Float64})
    pose, body = one.select("x", "y", "z").to_numpy(), one.select("u", "v", "w").to_numpy()
    turn = rotation(*(one[angle].to_numpy() for angle in ("phi", "theta", "psi")))
    world = np.einsum("kij,kj->ki", turn, body)
    derivative = (pose[2:] - pose[:-2]) / 0.04
    assert np.sqrt(np.mean((world[1:-1] - derivative) ** 2)) < 2e-3


def test_the_rotor_is_integrated_as_stonefish_does(datasets: Path) -> None:
    known, _ = vehicle.read(datasets / "stonefish" / "vehicle.toml")
    effects.validate(known)
    assert {thruster.lag_step for thruster in known.thruster} == {0.002}
    assert {thruster.lag for thruster in known.thruster} == {"speed"}


def test_samples_are_rows_of_the_full_recordings(datasets: Path, stonefish: Path) -> None:
    sample = table.read(datasets / "stonefish" / "sample.parquet").frame
    heads = pl.scan_parquet(stonefish / "nominal.parquet").filter(
        pl.int_range(pl.len()).over("session") < 1033
    )
    assert heads.collect().equals(sample)
    assert pl.read_parquet(stonefish / "replay90.parquet").equals(
        table.read(datasets / "stonefish" / "replay90.parquet").frame
    )
