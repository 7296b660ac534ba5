"""One plain sentence for every effect of the catalogue, whatever its values and errors are."""

from __future__ import annotations

import dataclasses
import math
import re
from typing import Any

import msgspec
import numpy as np
import pytest
from bench import BARE, equipped
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.effects import CATALOGUE
from hydro.core.effects.sentences import sentence
from hydro.core.effects.wording import POINTS, compass, group, listed, place, quantity
from hydro.core.vehicle.description import Thruster, Vehicle

SIX = [1.3, 150.4, 284.3, 0.52, 4.1, 12.6]
TYPICAL: dict[str, dict[str, Any]] = {
    "added_mass": {"diagonal": [10.2, 60.7, 70.1, 1.03, 8.2, 9.4]},
    "added_mass_coupling": {"M15": -3.1, "M24": 2.2, "M04": 1.1, "M13": -0.6, "M02": 4.0},
    "added_mass_coriolis": {"kappa": 0.31},
    "linear_damping": {"diagonal": SIX},
    "quadratic_damping": {"diagonal": SIX},
    "coupled_damping": {"D15": -12.3, "D51": 8.4, "D24": 3.3, "D42": 2.2, "D13": 0.9, "D31": 0.4},
    "cross_axis_drag": {"D01": 40.2, "D02": 31.1, "D10": 12.2, "D20": 9.1, "D50": 5.5},
    "power_drag": {"diagonal": SIX, "n": 1.83},
    "offset_drag": {"drag": [52.3, 20.1, 11.4], "position": [0.3, 0.0, 0.2]},
    "crossflow_drag": {"Cd_y": 1.13, "Cd_z": 0.82},
    "ellipsoid_drag": {"C": [0.61, 0.92, 1.13], "position": [0.02, 0.0, -0.03]},
    "body_lift": {"L11": 28.6, "L15": -6.1, "L51": -10.6, "L55": 3.9, "L22": 28.6, "L24": 6.1},
    "control_surface": {
        "area": 0.021,
        "position": [-0.6, 0.0, 0.0],
        "roll": 1.57,
        "deflection": 0.05,
        "stall": 0.35,
        "turn": [0.35],
        "commands": ["c2"],
    },
    "net_buoyancy": {"dB": 5.24},
    "buoyancy_offset": {"dx": 0.0203, "dy": 0.0, "dz": -0.0104},
    "payload": {"w": 31.2, "x": 0.22, "y": 0.0, "z": 0.1, "mass": 4.1},
    "drifting_ballast": {"S": [2.03, 0.0], "tilt": 0.2, "T": 2.1},
    "ocean_current": {"v_N": 0.2, "v_E": -0.15, "v_D": 0.0},
    "current_shear": {"g_N": 0.04, "g_E": 0.03, "z_0": 12.0},
    "current_trend": {"a_N": 1e-3, "a_E": -1e-3, "t_0": 30.0},
    "ocean_waves": {"height": 0.52, "period": 5.1, "direction": 1.57, "peak": 2.3},
    "tether": {"k": 5.2, "slack": 10.3, "attachment": [-0.5, 0.0, 0.0], "anchor": [30.0, -10.0, 5.0]},
    "surface_suction": {"A": 12.3, "decay": 0.82},
    "fluid_memory": {"K": [[0.0, 40.0, 120.0, 0.0, 3.0, 4.0]], "rates": [2.0]},
    "thruster_gain": {"g": [-0.35, 0.01]},
    "thruster_asymmetry": {"a": 0.2},
    "thruster_lag": {"dT": 0.152},
    "command_delay": {"d": 0.203},
    "thruster_deadband": {"d": 0.051},
    "thruster_curve": {"da": 0.97},
    "thruster_inflow": {"c": 0.21},
    "propeller_torque": {"k": [0.021, -0.018]},
    "sensor_scale": {"axes": [0.031, -0.018, 0.0]},
    "sensor_misalignment": {"alpha": [0.0, 0.021, 0.052]},
    "sensor_delay": {"d": 0.161},
    "sensor_lever_arm": {"r": [0.32, 0.0, 0.11]},
    "reference_point": {"r": [-0.22, 0.0, 0.17]},
    "sensor_bias": {"b": [0.031, -0.012, 0.008]},
    "formula": {"forces": ["Y |v|^n v"], "force": [-41.2], "exponents": [0.83]},
}
WORDS = ("commands", "forces", "moments")
KINDS = (
    "typical",
    "signed",
    "wide",
    "nan",
    "missing",
    "zero",
    "not finite",
    "file",
    "file wide",
    "file same",
)


def mapped(value: Any, function: Any) -> Any:
    """The same nesting with a function of each number."""
    if isinstance(value, list):
        return [mapped(one, function) for one in value]
    return value if isinstance(value, str) else function(value)


def table(values: dict[str, Any], function: Any) -> dict[str, Any]:
    return {key: mapped(value, function) for key, value in values.items() if key not in WORDS}


def told(name: str, kind: str, *, brief: bool = False) -> str:
    """The sentence of an effect for one kind of values and errors."""
    values = TYPICAL[name]
    words = {key: value for key, value in values.items() if key in WORDS}
    errors = table(values, lambda one: 0.03 * abs(one) + 1e-4)
    vehicle = BARE
    if kind == "signed":
        values = words | table(values, lambda one: -one)
    if kind.endswith("wide"):
        errors = table(values, lambda one: abs(one) + 1e-3)
    if kind == "nan":
        errors = table(values, lambda one: math.nan)
    if kind == "missing":
        errors = {}
    if kind == "zero":
        errors = table(values, lambda one: 0.0)
    if kind == "not finite":
        values = words | table(values, lambda one: math.nan)
    if kind.startswith("file"):
        factor = 1.0 if kind == "file same" else 0.75
        vehicle = equipped({"name": name} | words | table(values, lambda one: factor * one))
    return sentence(vehicle, name, values, errors, 0.02, brief=brief)


def test_every_effect_is_tried() -> None:
    assert set(TYPICAL) == set(CATALOGUE)
    for name, values in TYPICAL.items():
        CATALOGUE[name].pack(values, thrusters=2)
        assert CATALOGUE[name].sentence is not None


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", CATALOGUE)
def test_every_sentence_is_plain(name: str, kind: str) -> None:
    check(told(name, kind), name)


def check(text: str, name: str) -> None:
    """Whether a sentence has the form that all of them share."""
    assert text.endswith(".")
    assert not text.endswith("..")
    assert text[0].isupper()
    assert len(text) <= 220
    assert 1 <= len(re.findall(r"\.(?:\s|$)", text)) <= 2
    assert not re.search(r"\b(?:nan|inf|None|np)\b|\[|\]|[sm]\^\d|  | \.|-0\b(?!\.)", text), text
    for written in re.findall(r"(?<![\d.])\d[\d.]*\d", text.partition("t = ")[0]):
        assert len(written.replace(".", "").strip("0")) <= 5, text
    keys = [one.name for one in CATALOGUE[name].parameters if len(one.name) > 2 and one.name in TYPICAL[name]]
    keys = [key for key in keys if "_" in key or any(letter.isdigit() for letter in key)]
    keys += ["v_N", "v_E", "v_D", "dB", "dT", "Cd_y", "alpha", "kappa"]
    assert not [key for key in keys if re.search(rf"\b{key}\b", text)], text


def fleet(count: int, *effects: dict[str, Any], servo: bool = False) -> Vehicle:
    """A vehicle with many thrusters, the last a servo on request."""
    some = [Thruster(f"T{i + 1}", 80.0, 80.0, (0.1 * i, 0.0, 0.0), (1.0, 0.0, 0.0)) for i in range(count)]
    some += [Thruster("fin", curve="none")] if servo else []
    return msgspec.structs.replace(BARE, thruster=tuple(some), effect=effects)


def gains(shares: list[float], errors: Any = 0.02, vehicle: Vehicle | None = None) -> str:
    """The sentence on thrusters that deliver shares of the thrust of the file."""
    spread = errors if isinstance(errors, list) else [errors] * len(shares)
    values = {"g": [share - 1.0 for share in shares]}
    return sentence(vehicle or fleet(len(shares)), "thruster_gain", values, {"g": spread}, 0.02)


WEAK = [1.0, 0.99, 0.65, 1.02, 0.98, 1.0]
GAINS = {
    "Thruster 3 delivers 65 % (±2) of its modelled thrust; all others 98 to 102 %.": gains(WEAK),
    "All thrusters deliver 75 % (±1) of their modelled thrust.": gains([0.75] * 6, 0.01),
    "Thrusters 1, 2 and 4 to 6 deliver 75 % (±1); thruster 3 another 35 % less. "
    "Thruster 7 is not determined by this log.": gains(
        [0.75, 0.75, 0.49, 0.75, 0.75, 0.75, 1.0], [0.01] * 6 + [math.nan]
    ),
    "All thrusters deliver 75 % (±1); thruster 3 another 35 % less.": gains(
        [0.75, 0.75, 0.4875, 0.75, 0.76, 0.75], 0.01
    ),
    "Thruster 3 delivers nothing; all others 100 %.": gains([1.0, 1.0, 0.03, 1.0]),
    "Thruster 3 is reversed, or its column is swapped; all others 100 %.": gains([1.0, 1.0, -1.03, 1.0]),
    "Thrusters 2 and 3 are reversed, or their columns are swapped; all others 100 %.": gains([1, -1, -1, 1]),
    "Thruster 1 is reversed at 50 % (±2) of its modelled thrust; all others 100 %.": gains([-0.5, 1, 1, 1]),
    "Thruster 4 delivers 65 % (±2) of its modelled thrust; the others 100 %. "
    "Thrusters 1 and 2 are not determined by this log.": gains(
        [1.0, 0.8, 1.0, 0.65, 1.0], [0.3, math.nan, 0.02, 0.02, 0.02]
    ),
    "Thrusters 1 and 2 are not determined by this log.": gains([0.5, 0.6], [0.4, math.inf]),
    "All thrusters deliver 98 to 102 % of their modelled thrust.": gains([0.98, 1.0, 1.02]),
    "Thruster 2 delivers 50 % (±2) of its modelled thrust; all others 100 %.": gains(
        [1.0, 0.45, 1.0], vehicle=fleet(3, {"name": "thruster_gain", "g": [0.0, -0.1, 0.0]})
    ),
    "Thruster 1 delivers 65 % (±2) of its modelled thrust; thruster 2 100 %.": gains(
        [0.65, 1.0, 0.2], vehicle=fleet(2, servo=True)
    ),
}


@pytest.mark.parametrize(("wanted", "text"), GAINS.items(), ids=range(len(GAINS)))
def test_gains_of_thrusters(wanted: str, text: str) -> None:
    assert text == wanted


def of(name: str, values: dict[str, Any], errors: dict[str, Any], *effects: dict[str, Any]) -> str:
    return sentence(equipped(*effects), name, values, errors, 0.02)


DRAG = {"name": "quadratic_damping", "diagonal": [40.0, 150.0, 218.0, 4.0, 20.0, 18.0]}
SPREAD = {"diagonal": [4.0, 9.0, 6.0, 1.0, 2.0, 2.0]}
EXACT = {
    "All thrusters deliver 75 % (±1) of their modelled thrust.": of(
        "thruster_gain", {"common": -0.25}, {"common": 0.01}
    ),
    "A current of 0.25 m/s (±0.01) flows toward 323° (NW).": of(
        "ocean_current", {"v_N": 0.2, "v_E": -0.15}, {"v_N": 0.01, "v_E": 0.01}
    ),
    "A current of 0.25 m/s (±0.01) flows toward 90° (E) and upward at 0.05 m/s (±0.01).": of(
        "ocean_current", {"v_E": 0.25, "v_D": -0.05}, {"v_N": 0.01, "v_E": 0.01, "v_D": 0.01}
    ),
    "The current is 0.25 m/s (±0.01) toward 180° (S), not 0.1 m/s toward 0° (N) as in the file.": of(
        "ocean_current", {"v_N": -0.25}, {"v_N": 0.01}, {"name": "ocean_current", "v_N": 0.1}
    ),
    "The vehicle is 31 N (3.2 kg in water) heavier than modelled, "
    "at 0.22 m forward, 0.10 m below the origin.": of(
        "payload",
        {"w": 31.2, "x": 0.22, "y": 0.01, "z": 0.1},
        {"w": 1.0, "x": 0.01, "y": 0.02, "z": 0.01},
    ),
    "The vehicle is 5.2 N (0.53 kg in water) lighter than modelled.": of(
        "net_buoyancy", {"dB": 5.2}, {"dB": 0.1}
    ),
    "The centre of buoyancy lies 0.020 m (±0.001) forward and 0.010 m above where the file has it.": of(
        "buoyancy_offset", {"dx": 0.02, "dz": -0.01}, {"dx": 0.001, "dy": 0.001, "dz": 0.001}
    ),
    "DVL velocity arrives 0.16 s (±0.01) late.": of("sensor_delay", {"d": 0.16}, {"d": 0.01}),
    "DVL velocity arrives 0.020 s (±0.002) late, no more than one sample of the log.": of(
        "sensor_delay", {"d": 0.02}, {"d": 0.002}
    ),
    "Commands take effect 0.20 s (±0.01) later than modelled.": of("command_delay", {"d": 0.2}, {"d": 0.01}),
    "Thrusters answer with a time constant 0.15 s (±0.01) longer than modelled.": of(
        "thruster_lag", {"dT": 0.15}, {"dT": 0.01}
    ),
    "Heave drag is 1.3 times the file's value (284 ± 6, was 218 N s²/m²).": of(
        "quadratic_damping", {"diagonal": [40.0, 150.0, 284.0, 4.0, 20.0, 18.0]}, SPREAD, DRAG
    ),
    "Heave drag is 1.02 times the file's value (222 ± 6, was 218 N s²/m²), within its uncertainty.": of(
        "quadratic_damping", {"diagonal": [40.0, 150.0, 222.0, 4.0, 20.0, 18.0]}, SPREAD, DRAG
    ),
    "Quadratic damping of 284 N s²/m² (±6) in heave is missing.": of(
        "quadratic_damping", {"diagonal": [0.0, 0.0, 284.0, 0.0, 0.0, 0.0]}, SPREAD
    ),
    "The DVL is turned 3.0° (±0.2) to starboard in yaw against the body.": of(
        "sensor_misalignment", {"alpha": [0.0, 0.0, 0.0524]}, {"alpha": [0.003, 0.003, 0.003]}
    ),
    "DVL velocity reads 3.0 % (±0.2) too high.": of("sensor_scale", {"s": 0.03}, {"s": 0.002}),
    "In reverse, thrusters deliver 80 % (±2) of their nominal thrust.": of(
        "thruster_asymmetry", {"a": 0.2}, {"a": 0.02}
    ),
    "A steady pull of 12.0 N (±0.5) toward 90° (E) acts on the vehicle at the origin.": of(
        "tether", {"k": 12e-4, "anchor": [0.0, 1e4, 0.0]}, {"k": 0.5e-4}
    ),
    "The current, 0.02 m/s (±0.03) toward 0° (N), is not determined by this log.": of(
        "ocean_current", {"v_N": 0.02, "v_E": 0.0}, {"v_N": 0.03, "v_E": 0.03}
    ),
    "Added mass of 5.0 kg m (±0.5) in sway-yaw is missing.": of(
        "added_mass",
        {"matrix": [[5.0 * ({i, j} == {1, 5}) for j in range(6)] for i in range(6)]},
        {"matrix": [[0.5] * 6] * 6},
    ),
    "The thrusters' dead band is 5.0 % (±0.5) of full command narrower on each side than modelled.": of(
        "thruster_deadband", {"d": -0.05}, {"d": 0.005}
    ),
}


@pytest.mark.parametrize(("wanted", "text"), EXACT.items(), ids=range(len(EXACT)))
def test_sentences_word_for_word(wanted: str, text: str) -> None:
    assert text == wanted


def test_the_thrust_curve_is_told_by_its_power() -> None:
    text = sentence(fleet(4), "thruster_curve", {"da": 0.98}, {"da": 0.05}, 0.02)
    assert text == "Thrust grows with the command to the power 1.98 (±0.05), not 1 as in the file."


def test_a_power_of_a_measured_thrust_curve_is_told_as_one() -> None:
    vehicle = fleet(4)
    measured = [msgspec.structs.replace(one, curve="t200") for one in vehicle.thruster]
    vehicle = msgspec.structs.replace(vehicle, thruster=tuple(measured))
    text = sentence(vehicle, "thruster_curve", {"da": 0.98}, {"da": 0.05}, 0.02)
    assert text == "The share of full thrust is that of the file's curve to the power 1.98 (±0.05), not 1."


def test_one_of_several_effects_of_a_kind_is_compared_with_itself_alone() -> None:
    vehicle = equipped({"name": "payload:camera", "w": 10.0}, {"name": "payload:sonar", "w": 20.0})
    text = sentence(vehicle, "payload:sonar", {"w": 30.0}, {"w": 1.0}, 0.02)
    assert text == "The payload's weight in water is 1.5 times the file's value (30 ± 1, was 20 N)."
    assert "heavier than modelled" in sentence(vehicle, "payload", {"w": 30.0}, {"w": 1.0}, 0.02)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", [name for name in CATALOGUE if name not in ("formula", "control_surface")])
def test_an_effect_without_a_sentence_gets_a_generic_one(
    name: str, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(CATALOGUE, name, without_sentence(CATALOGUE[name]))
    text = told(name, kind)
    assert text.endswith(".")
    assert len(text) <= 220
    assert not re.search(r"\bnan\b|\[-?\d[^\]]*, ", text)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", CATALOGUE)
def test_a_brief_sentence_has_no_standard_errors(name: str, kind: str) -> None:
    text = told(name, kind, brief=True)
    assert text.endswith(".")
    assert "±" not in text
    assert len(text) <= len(told(name, kind))


def test_all_six_entries_are_listed_the_last_ones_without_standard_errors() -> None:
    values = {"diagonal": [300.0, 280.0, 284.0, 12.0, 50.0, 30.0]}
    text = of("quadratic_damping", values, SPREAD, DRAG)
    assert 1 <= text.count("±") <= 3
    assert sum(axis in text for axis in ("urge", "way", "eave", "oll", "itch", "aw")) == 6
    assert "more change" not in text


def without_sentence(effect: Any) -> Any:
    """The record without its sentence."""
    return dataclasses.replace(effect, sentence=None)


def test_the_generic_sentence_has_axes_and_units(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("quadratic_damping", "net_buoyancy", "thruster_lag"):
        monkeypatch.setitem(CATALOGUE, name, without_sentence(CATALOGUE[name]))
    values = {"diagonal": [0.0, 0.0, 284.0, 0.0, 0.0, 0.0]}
    heave = of("quadratic_damping", values, SPREAD)
    assert heave == "Quadratic damping of 284 N s²/m² (±6) in heave is missing."
    wanted = "Net buoyancy of 5.2 N (±0.1) as extra buoyancy is missing."
    assert of("net_buoyancy", {"dB": 5.2}, {"dB": 0.1}) == wanted
    changed = "Added time constant is 0.15 s (±0.01, was 0.1 s)."
    assert of("thruster_lag", {"dT": 0.15}, {"dT": 0.01}, {"name": "thruster_lag", "dT": 0.1}) == changed


ANY = st.floats(allow_nan=True, allow_infinity=True)
USUAL = st.floats(-3.0, 2.0)
SPREADS = st.one_of(st.floats(0.0, 0.5), ANY)


@given(st.lists(st.tuples(st.one_of(USUAL, ANY), SPREADS, st.floats(-1.0, 0.5)), min_size=1, max_size=16))
def test_gains_of_any_values_have_a_sentence(some: list[tuple[float, float, float]]) -> None:
    values, errors, before = (list(column) for column in zip(*some, strict=True))
    for vehicle in (fleet(len(some)), fleet(len(some), {"name": "thruster_gain", "g": before})):
        text = sentence(vehicle, "thruster_gain", {"g": values}, {"g": errors}, 0.02)
        check(text, "thruster_gain")
        check(
            sentence(vehicle, "thruster_gain", {"common": values[0]}, {"common": errors[0]}, 0.02),
            "thruster_gain",
        )


SCALES = st.floats(-4.0, 4.0).map(lambda power: 10.0**power)


@given(st.sampled_from(sorted(CATALOGUE)), SCALES, st.sampled_from([-1.0, 1.0]), SCALES, st.randoms())
def test_values_of_any_size_have_a_plain_sentence(
    name: str, size: float, sign: float, spread: float, draw: Any
) -> None:
    words = {key: value for key, value in TYPICAL[name].items() if key in WORDS}
    values = table(TYPICAL[name], lambda one: sign * size * one * draw.choice([0.0, 0.1, 1.0, 3.0]))
    errors = table(values, lambda one: spread * abs(one) * draw.choice([0.0, 0.1, 1.0, math.nan]))
    before = words | table(values, lambda one: one * draw.choice([-1.0, 0.0, 0.9, 1.0, 50.0, 1e3]))
    check(sentence(BARE, name, words | values, errors, 0.02), name)
    check(sentence(equipped({"name": name} | before), name, words | values, errors, 0.02), name)


SPEEDS = st.floats(-3.0, 3.0).filter(lambda one: abs(one) > 0.05)


@given(SPEEDS, SPEEDS)
def test_compass_words_agree_with_the_direction(north: float, east: float) -> None:
    text = of("ocean_current", {"v_N": north, "v_E": east}, {"v_N": 0.01, "v_E": 0.01})
    found = re.search(r"toward (\d+)° \((\w+)\)", text)
    assert found is not None
    heading, named = int(found[1]), POINTS.index(found[2]) * 22.5
    truth = math.degrees(math.pi / 2 - math.atan2(north, east))
    for said, least in ((heading, 0.5), (named, 11.25)):
        away = (said - truth + 180.0) % 360.0 - 180.0
        assert abs(away) <= least + 1e-6
    assert 0 <= heading < 360


@given(st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3))
def test_places_name_the_side_of_each_coordinate(point: list[float]) -> None:
    text = place(point)
    for value, sides in zip(
        point, (("forward", "aft"), ("starboard", "port"), ("below", "above")), strict=True
    ):
        assert (sides[value > 0.0] not in text) or value == 0.0
        if abs(value) == max(map(abs, point)) > 0.005:
            assert sides[value < 0.0] in text


@given(st.floats(-1e5, 1e5), st.floats(1e-4, 1e3))
def test_a_written_number_is_within_its_error(value: float, error: float) -> None:
    text = quantity(value, error, "m")
    written, doubt = re.fullmatch(r"(-?[\d.e-]+) m \(±([\d.e-]+)\)", text).groups()  # type: ignore[union-attr]
    assert abs(float(written) - value) <= 0.51 * float(doubt) + 1e-9
    assert float(doubt) >= 0.6 * error


def test_lists_groups_and_headings() -> None:
    assert listed(["a"]) == "a"
    assert listed(["a", "b", "c"]) == "a, b and c"
    assert group([1, 2, 5]) == "thrusters 1, 2 and 5"
    assert group([4]) == "thruster 4"
    assert group(range(1, 9)) == "thrusters 1 to 8"
    assert group(range(1, 16, 2)) == "8 thrusters"
    assert compass(1.0, -1e-9) == "0° (N)"
    assert compass(-1.0, 0.0) == "180° (S)"
    assert place([0.0, 0.0, 0.0]) == "the origin"
    assert place([0.2, 0.0, 0.1], [0.5, 0.5, 0.5]) == "an undetermined place"
    assert place([-0.5, 0.2, 0.0]) == "0.50 m aft, 0.20 m to starboard of the origin"
    assert quantity(np.pi, unit="m/s") == "3.14 m/s"
