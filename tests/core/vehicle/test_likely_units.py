"""A number in another unit is doubted, with its place; vehicles as they are built are not."""

from __future__ import annotations

import warnings
from pathlib import Path

import msgspec
import pytest

from hydro import cli
from hydro.core.errors import DataError, HydroWarning
from hydro.core.vehicle import likely_units
from hydro.core.vehicle.description import Vehicle
from hydro.io import table, vehicle

ROOT = Path(__file__).resolve().parents[3]
FILES = sorted(path for path in (ROOT / "datasets").rglob("*.toml") if "[rigid_body]" in path.read_text())
VEHICLE = ROOT / "datasets" / "stonefish" / "vehicle.toml"
SAMPLE = ROOT / "datasets" / "stonefish" / "sample.parquet"


def changed(**parts: dict[str, object]) -> Vehicle:
    """The vehicle of the sample with other numbers in some of its tables."""
    known = vehicle.read(VEHICLE)[0]
    other = {name: msgspec.structs.replace(getattr(known, name), **values) for name, values in parts.items()}
    return msgspec.structs.replace(known, **other)


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_no_vehicle_of_ours_is_doubted(path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", HydroWarning)
        vehicle.read(path)


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"environment": {"water_density": 1.025}}, "is it in g/cm^3 or t/m^3? write 1025"),
        ({"environment": {"gravity": 981.0}}, "is it in cm/s^2? write 9.81"),
        ({"environment": {"gravity": 1.0}}, "is it in g? write 9.81"),
        ({"rigid_body": {"mass": 1e-9}}, "rigid_body.mass is 1e-09 kg: check the number"),
        ({"rigid_body": {"mass": 151e3}}, "is mass in kg, and are the hull's lengths in m?"),
        ({"rigid_body": {"mass": 1.51e9}}, "rigid_body.mass is 1.51e+09 kg: is it in g? write 1.51e+06"),
        ({"hull": {"length": 1e9}}, "hull.length is 1e+09 m: check the number"),
        ({"hull": {"width": 700.0}}, "hull.width is 700 m: is it in mm? write 0.7"),
        ({"buoyancy": {"force": 151.0}}, "is it in kg? it is a force, in N"),
        ({"buoyancy": {"force": 9000.0}}, "buoyancy.force is 9000 N and the weight 1481 N"),
        ({"buoyancy": {"center": (20.0, 0.0, 0.0)}}, "buoyancy.center is 20 m from the hull's middle"),
        ({"rigid_body": {"inertia": ((6e6, 0, 0), (0, 16e6, 0), (0, 0, 18e6))}}, "is it in kg m^2?"),
    ],
)
def test_a_number_in_another_unit(parts: dict[str, dict[str, object]], words: str) -> None:
    assert any(words in line for line in likely_units.doubts(changed(**parts)))


def test_thrusters() -> None:
    known = vehicle.read(VEHICLE)[0]
    strong = [msgspec.structs.replace(one, max_thrust=155e3) for one in known.thruster]
    assert (
        "is max_thrust in N?"
        in likely_units.doubts(msgspec.structs.replace(known, thruster=tuple(strong)))[0]
    )
    assert likely_units.doubts(msgspec.structs.replace(known, thruster=())) == [
        "thruster: there is none: no command can move this vehicle"
    ]
    assert likely_units.doubts(changed(buoyancy={"force": 0.0})) == [], "a file may leave it out"


@pytest.mark.parametrize(("step", "words"), [(0.02, ""), (20.0, "milliseconds"), (1e-4, "minutes")])
def test_the_clock_of_a_recording(step: float, words: str) -> None:
    assert words in likely_units.sampling(step)
    assert bool(words) == bool(likely_units.sampling(step))


def test_it_is_said_once_by_every_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "vehicle.toml"
    path.write_text(VEHICLE.read_text().replace("water_density = 1025.0", "water_density = 1.025"))
    said = f"hydro: warning: {path}: environment.water_density is 1.025 kg/m^3; water has 958 to 1240: is it "
    for line in (["check"], ["labels", str(SAMPLE), "-o", str(tmp_path / "labels.parquet"), "--vehicle"]):
        assert cli.main([*line, str(path)]) == 0
        assert [one.startswith(said) for one in capsys.readouterr().err.splitlines()].count(True) == 1
    raw = table.make("raw", table.read(SAMPLE).frame, stage="import", vehicle_text=path.read_text())
    table.write(raw, tmp_path / "raw.parquet")
    assert cli.main(["labels", str(tmp_path / "raw.parquet"), "-o", str(tmp_path / "labels.parquet")]) == 0
    assert capsys.readouterr().err.count("the vehicle in the footer: environment.water_density") == 1


def test_a_file_without_its_format_is_told_the_line(tmp_path: Path) -> None:
    path = tmp_path / "vehicle.toml"
    path.write_text(VEHICLE.read_text().replace(vehicle.FORMAT_LINE, ""))
    with pytest.warns(HydroWarning, match='add format = "hydro-vehicle/1" as its first line'):
        vehicle.read(path)


def test_an_effect_stands_in_a_file_once_unless_there_can_be_several() -> None:
    def twice(table: str) -> str:
        return f"{VEHICLE.read_text()}\n" + 2 * f"[[effect]]\n{table}\n"

    vehicle.parse(twice('name = "payload"\nw = 2.0'))
    with pytest.raises(
        DataError, match=r"ocean_current is effect\[.\] too: keep one.*only .*payload.* and tether"
    ):
        vehicle.parse(twice('name = "ocean_current"\nv_N = 0.1'))


@pytest.mark.parametrize("step", [1000.0, 1e-7])
def test_absurd_time_steps_are_refused_before_any_work(
    step: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    known = table.read(SAMPLE)
    frame = known.frame.with_columns(t=known.frame["t"] * (step / 0.02))
    made = table.make("raw", frame, stage="import", vehicle_text=VEHICLE.read_text())
    path = tmp_path / "raw.parquet"
    table.write(made, path)
    for line in (
        ["diagnose", VEHICLE, path],
        ["compare", VEHICLE, path],
        ["simulate", VEHICLE, path],
        ["check", path],
    ):
        assert cli.main([*map(str, line), *([] if line[0] == "check" else ["-o", str(tmp_path / "x")])]) == 1
        told = capsys.readouterr().err
        assert told.count("\n") == 1
        assert f"t [s] steps by {step:g} s" in told
