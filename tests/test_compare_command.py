"""`hydro compare` from the command line: artefact, pipe, terminal, an earlier comparison, bad input."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path

import polars as pl
import pytest
from command_lines import parse, pasted_from
from streams_here import on_terminal, piped

from hydro import cli
from hydro.io import table
from hydro.report import comparison

ROOT = Path(__file__).resolve().parents[1]
VEHICLE = ROOT / "datasets" / "stonefish" / "vehicle.toml"


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a short recording, a vehicle with more damping, and comparisons of both vehicles."""
    folder = tmp_path_factory.mktemp("compare")
    sample = table.read(ROOT / "datasets" / "stonefish" / "replay90.parquet").frame
    for name, rows in (("raw", sample[:2500]), ("other", sample[2000:])):
        table.write(
            table.make("raw", rows, stage="import", vehicle_text=VEHICLE.read_text()),
            folder / f"{name}.parquet",
        )
    damping = '\n[[effect]]\nname = "linear_damping"\ndiagonal = [230, 250, 230, 12, 18, 30]\n'
    (folder / "damped.toml").write_text(VEHICLE.read_text() + damping)
    assert run("compare", VEHICLE, folder / "raw.parquet", "-o", folder / "before.parquet")[:2] == (0, "")
    return folder


def run(*arguments: object) -> tuple[int, str, str]:
    out, error = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(error):
        code = cli.main([str(argument) for argument in arguments])
    return code, out.getvalue(), error.getvalue()


def test_the_artefact_passes_its_schema_and_records_its_inputs(work: Path) -> None:
    made = table.read(work / "before.parquet", "comparison")
    assert run("check", work / "before.parquet")[0] == 0
    assert made.provenance.stage == "compare"
    assert made.provenance.vehicle == VEHICLE.read_text()
    assert [one.kind for one in made.provenance.inputs if one.kind != "vehicle"] == ["raw"]


def test_a_pipe_gives_the_same_bytes_as_a_file(work: Path) -> None:
    done = piped("compare", VEHICLE, stdin=(work / "raw.parquet").read_bytes())
    (told,) = done.stderr.decode().splitlines()  # the headline, beside the pipe
    assert re.fullmatch(r"5 s ahead the error of the model is \S+ m/s; the noise floor is \S+ m/s\.", told)
    assert done.stdout == (work / "before.parquet").read_bytes()


def test_against_adds_a_column_with_the_earlier_errors(work: Path) -> None:
    line = ["compare", work / "damped.toml", work / "raw.parquet", "--against", work / "before.parquet"]
    assert run(*line, "-o", work / "after.parquet")[:2] == (0, "")
    made = table.read(work / "after.parquet", "comparison")
    inputs = [one.kind for one in made.provenance.inputs if one.kind != "vehicle"]
    assert inputs == ["raw", "comparison"]
    before = table.read(work / "before.parquet").frame.filter(level="force", by="all")
    after = made.frame.filter(level="force", by="all")
    assert after["before"].equals(before["rmse"].alias("before"))
    assert (after.filter(axis="all")["rmse"] < after.filter(axis="all")["before"]).all()


def test_a_terminal_gets_one_screen_and_no_table(work: Path) -> None:
    """Headline, seven rows of errors, three regimes and the next command; all else with --details."""
    code, printed = on_terminal("compare", VEHICLE, work / "raw.parquet", columns=80)
    assert code == 0
    lines = printed.strip().splitlines()
    assert len(lines) <= 40
    assert max(map(len, lines)) <= 80
    assert lines[0].startswith("5 s ahead the error of the model is")
    (header,) = (line for line in lines if line.startswith("Error 5 s ahead"))
    assert header.split()[-7:] == ["error", "noise", "floor", "least", "squares", "zero", "velocity"]
    rows = [line.split() for line in lines if re.match(r"  (?:[uvwpqr]|all) \[", line)]
    assert [row[0] for row in rows] == [*"uvwpqr", "all"]
    assert all(float(row[2]) > float(row[3]) for row in rows), "errors are above the noise floor"
    assert len(re.findall(r"\d+ %; \d+\.\d times\s+the\s+average\s+of\s+this\s+axis\.", printed)) == 3
    (following,) = pasted_from(printed)
    assert following == f"hydro diagnose {VEHICLE} {work / 'raw.parquet'} -o diagnosis.parquet"
    parse(following)


def test_details_have_every_horizon_and_the_forces(work: Path) -> None:
    code, printed = on_terminal("compare", VEHICLE, work / "raw.parquet", "--details", columns=100)
    assert code == 0
    assert "PAR1" not in printed
    for words in ("Unexplained force", "1 s", "20 s", "whole run", "Regimes", "surge"):
        assert words in printed
    line = ["compare", work / "damped.toml", work / "raw.parquet", "--against", work / "before.parquet"]
    code, printed = on_terminal(*line, "--details", columns=100)
    assert code == 0
    assert " -> " in printed
    assert "Regimes of the earlier comparison" in printed
    assert re.search(r"^Error 5 s ahead +before +error", printed, re.MULTILINE)


def test_text_replaces_the_table_in_a_pipe(work: Path) -> None:
    done = piped("compare", VEHICLE, work / "raw.parquet", "--text")
    assert done.stdout.decode().startswith("5 s ahead the error of the model is")
    assert b"hydro diagnose" in done.stdout
    assert done.stderr == b""
    code, out, error = run("compare", VEHICLE, work / "raw.parquet", "--text", "--json")
    assert (code, out) == (2, "")
    assert "--text and --json both write to stdout: choose one" in error


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["{vehicle}", "nowhere.parquet"], 1, r"nowhere\.parquet: no such file"),
        (["nowhere.toml", "{work}/raw.parquet"], 1, r"nowhere\.toml"),
        (["{vehicle}", "{work}/before.parquet"], 1, r"before\.parquet"),
        (["{vehicle}", "{work}/raw.parquet", "--against", "{work}/raw.parquet"], 1, r"raw\.parquet"),
        (
            ["{vehicle}", "{work}/other.parquet", "--against", "{work}/before.parquet"],
            1,
            r"before\.parquet: a comparison with another recording; name one",
        ),
        (
            ["{root}/datasets/vehicles/auv151.toml", "{work}/short.parquet"],
            1,
            r"short\.parquet: .+longer",
        ),
        (["{root}/datasets/vehicles/remus100.toml", "{work}/raw.parquet"], 1, r"raw\.parquet: .+ thrusters"),
        ([], 2, r"missing argument"),
    ],
)
def test_bad_input_gives_a_one_line_error(arguments: list[str], code: int, message: str, work: Path) -> None:
    short = table.read(work / "raw.parquet").frame[:4]
    table.write(table.make("raw", short, stage="import"), work / "short.parquet")
    line = [one.format(vehicle=VEHICLE, work=work, root=ROOT) for one in arguments]
    found, out, error = run("compare", *line, "-o", work / "never.parquet")
    assert (found, out) == (code, "")
    assert re.fullmatch(rf"hydro: .*{message}.*\n", error), error
    assert not (work / "never.parquet").exists()


def test_the_headline_of_an_exact_model_says_within_its_noise() -> None:
    frame = pl.DataFrame(
        {
            "level": ["force"], "by": ["all"], "axis": ["Z"], "place": ["all"], "rows": [10], "rmse": [1.0],
            "share": [0.0], "rank": [None], "unit": ["N"], "horizon": [None],
            "noise_floor": [0.5],
        },
        schema_overrides={"rank": pl.Int64, "horizon": pl.Float64},
    )  # fmt: skip
    assert comparison.headline(frame) == "The model predicts this log to within its noise."
    ranked = frame.with_columns(by=pl.lit("place"), place=pl.lit("while diving"), share=0.416, rank=1, rows=1)
    told = comparison.worst_place(pl.concat([frame, ranked.cast({"rank": pl.Int64, "rows": pl.Int64})]))
    share = "Heave while diving: 42 % of the unexplained squared error; "
    assert told == f"{share}1.0 times the average of this axis."


def test_regimes_show_a_weak_thruster_and_a_current_in_stonefish_recordings(stonefish: Path) -> None:
    """A weak thruster 3 (front left to right aft pushes yaw) and a current, with the same damping."""
    from hydro.core.evaluation.compare import compare
    from hydro.core.identification.fit import fit
    from hydro.io import vehicle

    known = vehicle.read(VEHICLE)[0]
    nominal = (
        pl.read_parquet(stonefish / "nominal_test.parquet")
        .group_by("session", maintain_order=True)
        .head(1500)
    )
    model = fit(known, nominal, ["linear_damping", "quadratic_damping"], method="equation").vehicle

    def forces(name: str) -> dict[str, float]:
        raw = pl.read_parquet(stonefish / f"{name}.parquet")
        whole = compare(model, raw).filter(level="force", by="all")
        return dict(whole.select("axis", "rmse").iter_rows())

    ordinary, weak, drifting = (
        forces(n) for n in ("replay90", "v3_thruster3_replay90", "v1_current_replay90")
    )
    assert weak["N"] > 2.0 * ordinary["N"]
    assert drifting["X"] > 1.4 * ordinary["X"]
    assert drifting["Y"] > 1.4 * ordinary["Y"]
    assert drifting["N"] < 1.3 * ordinary["N"]
