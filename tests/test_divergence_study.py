"""Study of the divergence of trainings: its cells, networks, flights, trainings and table."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from benchmarks.divergence import __main__ as command
from benchmarks.divergence import open_loop, trainings
from benchmarks.divergence.cells import CELLS, POOR, Cell, Data, cell_of
from benchmarks.divergence.networks import STONEFISH, Source, network
from benchmarks.divergence.summary import kept
from hydro.io import table
from hydro.io import vehicle as vehicles
from hydro.rl.environment.conditions import Condition, zero_model
from hydro.rl.training.runs import changed

VEHICLE = vehicles.read(STONEFISH / "vehicle.toml")[0]
STEPS = 100


def factors(cell: Cell) -> dict[str, object]:
    data = {field.name: getattr(cell.data, field.name) for field in fields(Data)}
    return data | {"conditioning": cell.conditioning, "lead": cell.lead}


def decays() -> dict[str, open_loop.Flights]:
    """Four seconds of eight flights without thrust."""
    given = open_loop.flights(VEHICLE, STONEFISH / "replay90.parquet")["decay"]
    return {"decay": open_loop.Flights(given.pose[:8], given.velocity[:8], given.commands[:STEPS, :8])}


def pushing(gain: float) -> Condition:
    """A network that pushes along the velocity with `gain` [N s/m, N m s], without conditioning."""
    model = zero_model()
    weight = np.zeros((6, 12), np.float32)
    weight[:, :6] = -gain * np.eye(6)  # the vehicle feels the negative output
    model = replace(model, tensors=model.tensors | {"layers.0.weight": weight})
    return Condition("R_MLP", model, "off")


def test_cells_change_one_factor_of_the_centre_or_are_named_as_pairs() -> None:
    centre = factors(cell_of("centre"))
    for cell in CELLS:
        changes = {name for name, value in factors(cell).items() if value != centre[name]}
        named = cell.name.count(",") + 1 if cell.name != "centre" else 0
        assert len(changes) == named, cell.name
    assert len({repr(factors(cell)) for cell in CELLS}) == len(CELLS)


def test_energy_is_kept_without_damping_lost_with_it_and_gained_by_a_pushing_network() -> None:
    free, damped, pushed = (
        open_loop.measure(VEHICLE, condition, decays())
        for condition in (Condition("R_0+M_A", None, "off"), pushing(-100.0), pushing(200.0))
    )
    assert (free["gaining_decay"], damped["gaining_decay"], pushed["gaining_decay"]) == (0.0, 0.0, 1.0)
    assert damped["left_decay"] < 0.3 < 0.8 < free["left_decay"] < 1.2
    assert pushed["gain_decay"] > 1.0 > 0.05 > free["gain_decay"]


def test_a_flight_that_exceeds_the_limit_of_speed_exploded() -> None:
    given = {"random": decays()["decay"]}
    found, slow = (open_loop.measure(VEHICLE, pushing(gain), given) for gain in (3000.0, -100.0))
    assert found["exploded_random"] == found["flights_random"] == 8
    assert found["fastest"] > 5.0 > slow["fastest"]
    assert slow["exploded_random"] == 0


def test_random_commands_are_bounded_correlated_and_the_same_for_all() -> None:
    given = open_loop.flights(VEHICLE, STONEFISH / "replay90.parquet")
    commands = given["random"].commands
    assert np.abs(commands).max() < 1.0
    assert np.corrcoef(commands[1:].ravel(), commands[:-1].ravel())[0, 1] == pytest.approx(0.95, abs=0.03)
    again = open_loop.flights(VEHICLE, STONEFISH / "replay90.parquet")["random"].commands
    assert np.array_equal(commands, again)
    assert given["full"].commands.shape[1] == 12
    assert given["replay"].commands.shape[0] == 2250


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Source:
    """Eight short sessions of the sample."""
    raw = table.read(STONEFISH / "sample.parquet", "raw")
    names = raw.frame["session"].unique(maintain_order=True)[:8]
    parts = raw.frame.filter(pl.col("session").is_in(names.to_list())).partition_by("session")
    frame = pl.concat(part.head(450) for part in parts)
    path = tmp_path_factory.mktemp("short") / "sample.parquet"
    table.write(table.make("raw", frame, stage="test", vehicle_text=raw.provenance.vehicle), path)
    return Source(sample=path, updates=20)


def test_a_network_learns_once_from_data_with_the_noise_of_its_seed(short: Source, tmp_path: Path) -> None:
    clean, noisy, other = (
        network(short, data, "mlp", seed, tmp_path) for data, seed in ((Data(), 0), (POOR, 0), (POOR, 1))
    )
    scales = [model.scalers["input_scale"][6] for model in (clean, noisy, other)]
    assert len(set(scales)) == 3
    assert clean.training["protocol"] == "paper"
    before = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    network(short, Data(), "mlp", 0, tmp_path)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()} == before


def test_rows_are_appended_and_not_repeated(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = list[tuple[str, str, int]]()

    def work(cell: Cell, condition: str, seed: int) -> dict[str, float]:
        asked.append((cell.name, condition, seed))
        return {"fastest": float("inf")}

    command.run("open", CELLS[:1], 1, tmp_path, work)
    command.run("open", CELLS[:1], 2, tmp_path, work)
    assert asked == [("centre", name, seed) for seed in (0, 1) for name in ("R_MLP", "R_PhysFeat")]
    assert [row["fastest"] for row in command.rows_of(tmp_path)] == [1e300] * 4
    assert len(capsys.readouterr().out.splitlines()) == 4
    assert all(json.loads(line) for line in (tmp_path / "rows.jsonl").read_text().splitlines())


def test_trainings_have_the_factors_of_their_cell_and_their_whole_budget() -> None:
    config = trainings.config(cell_of("beta weighs the old value"), "R_MLP", 3)
    assert (config.conditioning, config.wrench.lead, config.seed) == ("paper-old", 0.0, 3)
    assert trainings.config(cell_of("lead 0.5"), "R_MLP", 0).wrench.lead == 0.5
    assert config.curriculum.examine > config.steps
    small = {"vehicles": "8", "record": "80", "evaluate": "160", "episodes": "2", "settings.task.steps": "20"}
    small |= {"sac.layers": "[16,16]", "sac.batch": "16", "sac.random": "80", "sac.horizon": "3"}
    row = trainings.train(changed(replace(config, steps=320), small), VEHICLE, zero_model())
    assert (row["steps"], row["diverged"], row["numerical"]) == (320, "", 0)
    assert row["updates"] > 0
    assert 0.0 <= row["last"] <= row["best"] <= 1.0


def test_the_table_has_both_networks_of_a_cell_side_by_side() -> None:
    flown = {"part": "open", "cell": "centre", "numerical": 0, "fastest": 3.0}
    flown |= {"exploded_replay": 0, "exploded_random": 0, "exploded_full": 0}
    flown |= {"gaining_decay": 0.0, "gaining_fast": 0.0}
    learnt = {"part": "sac", "cell": "centre", "condition": "R_MLP", "diverged": "", "last": 0.9}
    rows = [
        flown | {"condition": "R_MLP", "seed": 0},
        flown | {"condition": "R_MLP", "seed": 1, "exploded_full": 2, "fastest": 2e5, "gaining_fast": 0.4},
        learnt | {"seed": 1, "diverged": "success", "last": 0.0},
        learnt | {"seed": 0},
    ]
    centre, *others = kept(rows)
    assert centre["R_MLP: explodes"] == "0, 0, 1 of 2; 2e+05 m/s"
    assert centre["R_MLP: gains energy"] == "0, 1 of 2; 10% of flights"
    assert centre["R_MLP: SAC diverges"] == "1 of 2 (success); arrivals 90, 0%"
    assert centre["R_PhysFeat: explodes"] == ""
    assert [row["cell"] for row in others] == [cell.name for cell in CELLS[1:]]
    assert not any(row["R_MLP: explodes"] for row in others)
