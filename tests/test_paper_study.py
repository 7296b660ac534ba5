"""The study of the paper as one command, and its tables."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest

from benchmarks import paper_rl
from hydro import cli
from hydro.io import table
from hydro.study import paper, paper_tables, policies

FOLDER = Path("study")


def settings(folder: Path, **other: object) -> paper.Study:
    return paper.Study(folder, Path("raw"), Path("replay"), Path("vehicle.toml"), **other)


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory, datasets: Path) -> tuple[Path, list[str]]:
    """A quick study of short recordings, and its command line."""
    folder = tmp_path_factory.mktemp("paper")
    stonefish = datasets / "stonefish"
    for name, sessions, rows in (("sample", 6, 400), ("replay90", 1, 100)):
        source = table.read(stonefish / f"{name}.parquet", "raw")
        names = source.frame["session"].unique(maintain_order=True)[:sessions]
        frame = source.frame.filter(pl.col("session").is_in(names.to_list()))
        short = pl.concat(one.head(rows) for one in frame.partition_by("session", maintain_order=True))
        made = table.make("raw", short, stage="test", vehicle_text=source.provenance.vehicle)
        table.write(made, folder / f"{name}.parquet")
    line = ["study", "paper", str(folder / "sample.parquet"), "--replay", str(folder / "replay90.parquet")]
    line += ["--quick", "-o", str(folder / "study")]
    assert cli.main(line) == 0
    return folder / "study", line


def contents(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.suffix in (".parquet", ".toml", ".pt"))
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def test_a_quick_study_has_every_table(quick: tuple[Path, list[str]]) -> None:
    folder, _ = quick
    tests = table.read(folder / "tests.parquet", "evaluations").frame
    assert set(tests["plant"]) == set(policies.SIMULATORS)
    assert set(tests["flown_by"]) == {"policy", "helmsman", "helmsman with map"}
    learnt = tests.filter(flown_by="policy")
    assert set(learnt["condition"]) == {"R_PhysFeat", "R_0+M_A"}
    assert set(learnt["recipe"]) == {"sac"}
    assert (learnt["updates"] > 0).all()
    known = {
        row["name"]: row["value"] for row in table.read(folder / "R_0+M_A-seed0/run.parquet").frame.to_dicts()
    }
    assert known["wrench.lead"] == "0.0"


def test_a_study_that_lost_files_makes_the_same_bytes_again(quick: tuple[Path, list[str]]) -> None:
    folder, line = quick
    before = contents(folder)
    (folder / "R_0+M_A-seed0" / "policy.parquet").unlink()
    (folder / "R_0+M_A-seed0" / "checkpoint.pt").unlink()
    (folder / "tests.parquet").unlink()
    assert cli.main(line) == 0
    assert contents(folder) == before


def test_tables_of_a_study_state_what_was_run(quick: tuple[Path, list[str]]) -> None:
    folder, _ = quick
    study = replace(paper.quick(settings(folder)), seeds=2)
    done = paper_tables.trainings(study)
    assert done["state"].to_list() == ["budget used", "budget used", "not run", "not run"]
    assert done.filter(seed=0)["processor"].is_not_null().all()
    offline, replayed = paper_tables.networks(study)
    assert set(offline["model"]) == {"mlp", "physfeat"}
    assert {"MJ0", "MJ1", "MJ4"} <= set(replayed["variant"])
    rows = paper_rl.trained(study, {})
    assert [(row["seed"], row["result"]) for row in rows[2:]] == [("1", "not run"), ("1", "not run")]
    assert rows[0]["SAC updates"] != "0"
    assert paper_rl.flown(study, {"forest": "pillars"}, {})[0]["in the reference simulator"]
    verdicts = {
        row["claim of the paper"].partition(" (")[0]: row["verdict"] for row in paper_rl.claims(study)
    }
    assert verdicts["R_MLP diverges in all runs"] == paper_rl.WAITING
    assert "so far (2 of 4" in verdicts["R_PhysFeat trains stably"]


def test_trainings_run_seed_by_seed_and_differ_in_the_physics_alone() -> None:
    study = settings(FOLDER, given=Path("given.toml"), seeds=2)
    runs = paper.runs(study)
    assert [run.condition for run in runs] == [*paper.CONDITIONS] * 2
    assert {run.vehicle for run in runs if run.condition not in ("R_effects", "R_identified")} == {
        Path("vehicle.toml")
    }
    lines = [step.line for step in paper.steps(study) if step.line[:2] == ("rl", "train")]
    own = {"R_MLP", "R_PhysFeat", "R_0", "R_0+M_A", "R_effects", "R_identified", "0", "1"}
    alike = {
        tuple(word for word in line[3:] if word not in own and not word.startswith(("study/", "--model")))
        for line in lines
    }
    assert len(lines) == 12
    assert len(alike) == 1


def test_without_a_given_vehicle_file_its_condition_is_left_out() -> None:
    assert "R_effects" not in {run.condition for run in paper.runs(settings(FOLDER))}


def test_every_file_is_made_before_it_is_read() -> None:
    study = settings(FOLDER, given=Path("given.toml"), seeds=1)
    made = {study.raw, study.replay, study.vehicle, study.given}
    for step in paper.steps(study):
        assert set(step.reads) <= made, step.name
        made.update(step.writes)


def curves(losses: list[float | None], diverged: int = 0) -> pl.DataFrame:
    return pl.DataFrame({"critic": losses, "diverged": [diverged] * len(losses)})


@pytest.mark.parametrize(
    ("losses", "shares", "diverged", "kind"),
    [
        ([None, 1.0, 2.0, 1.0], [0.9], 0, ""),
        ([1.0, 1.0, 1.0, 1.0, 500.0, 500.0], [0.9], 0, "critic"),
        ([1.0, 1.0, 1.0, 1.0, 500.0, 1.0], [0.9], 0, ""),
        ([1.0], [0.6, 0.0], 0, "success"),
        ([1.0], [0.4, 0.0], 0, ""),
        ([1.0], [0.9], 1, "numerical"),
    ],
)
def test_divergence_is_told_from_the_tables_of_a_training(
    losses: list[float | None], shares: list[float], diverged: int, kind: str
) -> None:
    evaluations = pl.DataFrame({"purpose": ["curve"] * len(shares), "success": shares})
    assert paper_tables.divergence(curves(losses, diverged), evaluations) == kind


def test_differences_have_newcombes_interval() -> None:
    """Newcombe (1998), Statistics in Medicine 17, 873, method 10: 56/70 - 48/80 is 0.2 [0.0524, 0.3339]."""
    row = {"flown_by": "policy", "plant": "kernels", "task": "forest", "seed": 0}
    tests = pl.DataFrame(
        [
            row | {"condition": "R_MLP", "success": 56 / 70, "episodes": 70},
            row | {"condition": "R_PhysFeat", "success": 48 / 80, "episodes": 80},
        ]
    )
    (found,) = paper_tables.differences(tests).to_dicts()
    assert found["condition"] == "R_MLP"
    assert [found[name] for name in ("difference", "low", "high")] == pytest.approx(
        [0.2, 0.0524, 0.3339], abs=5e-5
    )
