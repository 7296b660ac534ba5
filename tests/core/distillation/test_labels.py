from __future__ import annotations

import math
from pathlib import Path

import msgspec
import numpy as np
import polars as pl
import pytest
import synthetic
from hypothesis import given, settings
from hypothesis import strategies as st

from hydro.core.distillation.labels import filter_design, labels, subtracted
from hydro.core.errors import DataError
from hydro.core.recording.smoothing import Design, estimate
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.description import Vehicle
from hydro.io import vehicle as vehicle_file

VELOCITY = ("u", "v", "w", "p", "q", "r")
RES = [f"{name}_res" for name in "XYZKMN"]
PROP = [f"{name}_prop" for name in "XYZKMN"]
DOT = [f"{name}_dot" for name in VELOCITY]
THRUSTS = [f"f_{i + 1}" for i in range(8)]
ORDINARY = [0.01] * 3 + [0.002] * 3  # measurement noise [m/s, rad/s]
SPLINE = Design(0.02, (1e6,) * 6, (1e-6,) * 6)


@pytest.fixture(scope="module")
def raw() -> pl.DataFrame:
    return synthetic.recording()


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    return synthetic.vehicle()


def truth(raw: pl.DataFrame) -> np.ndarray:
    return np.array([synthetic.coriolis_and_damping(nu) for nu in raw.select(VELOCITY).to_numpy()])


def noisy(raw: pl.DataFrame, sigma: list[float], seed: int = 0) -> pl.DataFrame:
    rng = np.random.default_rng(seed)
    return raw.with_columns(
        pl.col(name) + pl.Series(s * rng.normal(size=raw.height))
        for name, s in zip(VELOCITY, sigma, strict=True)
    )


def residual(frame: pl.DataFrame) -> np.ndarray:
    return frame.select(RES).to_numpy().astype(float)


def test_labels_of_a_fossen_vehicle_are_its_coriolis_and_damping(raw, vehicle):
    """Against scipy, to 0.1 N and N m: every sign, frame, lever and time is in this."""
    error = np.abs(residual(labels(vehicle, raw)) - truth(raw))
    assert error[5:-5].max() < 0.1
    assert error.max() < 2.0
    assert np.abs(truth(raw)).max(axis=0).min() > 15


def test_stored_as_float32_they_are_the_same(raw, vehicle):
    small = raw.with_columns(pl.col(pl.Float64).exclude("t").cast(pl.Float32))
    np.testing.assert_allclose(residual(labels(vehicle, small)), residual(labels(vehicle, raw)), atol=0.02)


def test_a_command_shifted_by_one_row_is_seen(raw, vehicle):
    late = raw.with_columns(pl.col("^cmd_.*$").shift(1, fill_value=0.0))
    assert np.abs(residual(labels(vehicle, late)) - truth(raw))[5:-5].max() > 1.0


def test_two_sided_beats_the_papers_recipe_under_noise(raw, vehicle):
    measured, expected = noisy(raw, ORDINARY), truth(raw)
    likeliest = estimate(measured.select(VELOCITY).to_numpy(), [[0, raw.height]], 0.02)

    def errors(method, design=None):
        made = residual(labels(vehicle, measured, acceleration=method, design=design))
        return np.sqrt(np.mean((made - expected) ** 2, axis=0))

    rms = {method: errors(method, likeliest) for method in ("rts", "kalman", "kalman-difference")}
    assert (rms["rts"] < 0.7 * rms["kalman-difference"]).all()
    assert (rms["rts"] < 0.7 * rms["kalman"]).all()
    assert (rms["rts"][:3] < 6).all()
    followed = errors("rts")  # row by row noisier, see below what for
    assert (followed < 0.8 * errors("kalman-difference")).all()
    assert (followed < 0.7 * errors("kalman")).all()
    assert (followed[:3] < 9).all()


def test_averaged_over_noise_labels_are_truer_than_those_of_the_likeliest_filter(raw, vehicle):
    """The filter is linear: without noise it leaves what an average over noise would, its bias."""
    dvl = [0.05] * 3 + [0.01] * 3
    measured, bounds = noisy(raw, dvl), [[0, raw.height]]
    designs = filter_design(measured, dvl), estimate(measured.select(VELOCITY).to_numpy(), bounds, 0.02, dvl)
    bias = [residual(labels(vehicle, raw, design=design)) - truth(raw) for design in designs]
    closer, smoother = (np.sqrt(np.square(one[20:-20]).mean(axis=0)) for one in bias)
    assert (closer < 0.8 * smoother).all()


def test_known_noise_is_used(raw, vehicle):
    design = filter_design(raw, ORDINARY)
    assert design.noise == pytest.approx(ORDINARY)
    assert labels(vehicle, raw, noise=ORDINARY).equals(labels(vehicle, raw, design=design))


def test_raw_columns_stay_and_the_rest_is_float32(raw, vehicle):
    made = labels(vehicle, raw)
    assert made.select(raw.columns).equals(raw)
    added = [*(f"{name}_s" for name in VELOCITY), *DOT, *THRUSTS, *PROP, *RES]
    assert made.columns == raw.columns + added
    assert set(made.select(added).dtypes) == {pl.Float32}


def test_propulsion_is_the_thrusters_wrench(raw, vehicle):
    made = labels(vehicle, raw)
    B = np.array([[*d, *np.cross(p, d)] for p, d in synthetic.PLACES]).T
    np.testing.assert_allclose(made.select(PROP), made.select(THRUSTS).to_numpy() @ B.T, atol=1e-4)


def test_acceleration_is_of_the_row_itself(raw, vehicle):
    dot = labels(vehicle, raw).select(DOT).to_numpy()
    central = np.gradient(raw.select(VELOCITY).to_numpy(), 0.02, axis=0)
    np.testing.assert_allclose(dot[5:-5], central[5:-5], atol=5e-3)


@given(st.lists(st.integers(2, 40), min_size=1, max_size=6), st.integers(0, 9))
@settings(max_examples=15)
def test_a_session_does_not_depend_on_its_neighbours(lengths, seed):
    """With one filter: sessions in any number and order, and each session's second half after a gap."""
    raw, vehicle = synthetic.recording(), synthetic.vehicle()
    parts = [raw[k : k + rows].with_columns(session=pl.lit(f"s{k}")) for k, rows in enumerate(lengths)]
    together = labels(vehicle, pl.concat(parts), design=SPLINE)
    for part in np.random.default_rng(seed).permutation(len(parts)):
        alone = labels(vehicle, parts[part], design=SPLINE)
        assert together.filter(session=f"s{part}").equals(alone)


def test_after_a_gap_thrusters_have_settled_on_their_command(raw, vehicle):
    broken = pl.concat([raw[:100], raw[150:]])
    made = labels(vehicle, broken)
    settled = synthetic.MAX_THRUST * raw.select("^cmd_.*$").to_numpy()[150]
    np.testing.assert_allclose(made.select(THRUSTS).to_numpy()[100], settled, rtol=1e-6)
    assert np.abs(made.select(THRUSTS).to_numpy()[0]).max() == 0.0
    np.testing.assert_allclose(
        residual(made)[160:-5], truth(broken)[160:-5], atol=8.0
    )  # the lag forgets in 3 T
    np.testing.assert_allclose(residual(made)[200:-5], truth(broken)[200:-5], atol=0.1)


def with_effects(vehicle: Vehicle, *effects: dict[str, object]) -> Vehicle:
    return msgspec.structs.replace(vehicle, effect=(*vehicle.effect, *effects))


def test_without_added_mass_its_inertia_is_in_the_residual(raw, vehicle):
    bare = labels(msgspec.structs.replace(vehicle, effect=()), raw)
    full = labels(vehicle, raw)
    missing = full.select(DOT).to_numpy().astype(float) * synthetic.ADDED
    np.testing.assert_allclose(residual(bare) - residual(full), missing, atol=1e-3)


def test_damping_in_the_file_is_not_subtracted(raw, vehicle):
    damped = with_effects(vehicle, {"name": "linear_damping", "diagonal": [10.0] * 6})
    assert labels(damped, raw).equals(labels(vehicle, raw))


def test_actuator_effects_enter_the_thrust(raw, vehicle):
    weak = with_effects(vehicle, {"name": "thruster_gain", "g": [-0.4] + [0.0] * 7})
    before, after = (labels(v, raw).select(THRUSTS).to_numpy() for v in (vehicle, weak))
    np.testing.assert_allclose(after[:, 0], 0.6 * before[:, 0], rtol=1e-5)
    np.testing.assert_array_equal(after[:, 1:], before[:, 1:])


def test_inflow_is_of_the_water(raw, vehicle):
    """f - c sqrt(|f| f_max) d . v_r with a current, from the thrusts without."""
    c, flow = 0.05, np.array([0.3, 0.1, 0.0])
    inflow = {"name": "thruster_inflow", "c": c}
    carried = with_effects(vehicle, inflow, {"name": "ocean_current", "v_N": 0.3, "v_E": 0.1, "v_D": 0.0})
    f = labels(vehicle, raw).select(THRUSTS).to_numpy().astype(float)
    psi, nu = raw["psi"].to_numpy(), raw.select(VELOCITY).to_numpy()
    level = raw.select((pl.col("phi").abs() < 0.02) & (pl.col("theta").abs() < 0.02)).to_series().to_numpy()
    assert level.sum() > 10
    north, east = (
        np.stack([np.cos(psi), -np.sin(psi), 0 * psi], 1),
        np.stack([np.sin(psi), np.cos(psi), 0 * psi], 1),
    )
    v_r = nu[:, :3] - flow[0] * north - flow[1] * east
    for i, (position, direction) in enumerate(synthetic.PLACES[:4]):
        speed = (v_r + np.cross(nu[:, 3:], position)) @ direction
        expected = f[:, i] - c * np.sqrt(np.abs(f[:, i]) * synthetic.MAX_THRUST) * speed
        found = labels(carried, raw)[f"f_{i + 1}"].to_numpy()
        np.testing.assert_allclose(found[level], expected[level], atol=0.1)


# -- All effects subtracted ---------------------------------------------------------------------------------

DAMPING = (
    {"name": "linear_damping", "diagonal": list(synthetic.LINEAR)},
    {"name": "quadratic_damping", "diagonal": list(synthetic.QUADRATIC)},
)
EVERYTHING = (
    *DAMPING,
    {"name": "added_mass_coupling", "M15": 4.0, "M24": -3.0},
    {"name": "added_mass_coriolis", "kappa": -0.3},
    {"name": "crossflow_drag", "Cd_y": 0.4, "Cd_z": 0.3},
    {"name": "body_lift", "L11": 20.0, "L15": -5.0, "L22": 15.0},
    {"name": "payload", "w": 4.0, "x": 0.3, "y": -0.1, "z": 0.2, "mass": 6.0},
    {"name": "net_buoyancy", "dB": 3.0},
    {"name": "tether", "k": 6.0, "slack": 0.5, "anchor": [2.0, 1.0, 0.0], "attachment": [0.5, 0.0, 0.1]},
    {"name": "fluid_memory", "K": [[30.0, 40.0, 40.0, 2.0, 3.0, 3.0]], "rates": [2.0]},
    {"name": "ocean_current", "v_N": 0.3, "v_E": -0.2, "v_D": 0.05},
    {"name": "thruster_gain", "g": [-0.2] + [0.0] * 7},
    {"name": "thruster_inflow", "c": 0.02},
)


def rigid_coriolis(nu: np.ndarray) -> np.ndarray:
    """C_RB(nu) nu from Newton and Euler about CO, (N, 6); Fossen (2011), eq. 3.42."""
    v, omega, lever = nu[:, :3], nu[:, 3:], np.array(synthetic.WEIGHT_ARM)
    S = synthetic.cross(lever)
    about = np.array(synthetic.INERTIA) - synthetic.MASS * S @ S
    force = synthetic.MASS * np.cross(omega, v + np.cross(omega, lever))
    moment = np.cross(omega, omega @ about.T) + synthetic.MASS * np.cross(lever, np.cross(omega, v))
    return np.hstack([force, moment])


def test_effects_that_are_the_whole_truth_leave_the_rigid_bodys_coriolis(raw, vehicle):
    """Against scipy: added mass with its C_A, and damping."""
    left = residual(labels(with_effects(vehicle, *DAMPING), raw, subtract="effects"))
    expected = rigid_coriolis(raw.select(VELOCITY).to_numpy())
    assert np.abs(left - expected)[5:-5].max() < 0.1
    assert np.abs(expected).max() > 20.0


def test_all_effects_at_once_in_a_current_leave_the_same(raw, vehicle):
    full = with_effects(vehicle, *EVERYTHING)
    moved = simulate(full, raw)
    left = residual(labels(full, moved, design=SPLINE, subtract="effects"))
    expected = rigid_coriolis(moved.select(VELOCITY).to_numpy())
    assert np.abs(left - expected)[10:-10].max() < 0.15
    for effect in ("tether", "fluid_memory", "ocean_current", "payload", "added_mass"):
        less = msgspec.structs.replace(full, effect=tuple(e for e in full.effect if e["name"] != effect))
        wrong = residual(labels(less, moved, design=SPLINE, subtract="effects"))
        assert np.abs(wrong - expected)[10:-10].max() > 1.0, effect


def test_a_vehicle_without_effects_has_the_same_labels_either_way(raw, vehicle):
    bare = msgspec.structs.replace(vehicle, effect=())
    assert labels(bare, raw, subtract="effects").equals(labels(bare, raw))


def test_what_is_subtracted_is_named(vehicle):
    full = with_effects(vehicle, *EVERYTHING)
    assert subtracted(full, "inertia") == ["added_mass", "added_mass_coupling", "payload"]
    thrusters = ("thruster_gain", "thruster_inflow")
    assert subtracted(full, "effects") == [e["name"] for e in full.effect if e["name"] not in thrusters]


def test_errors_of_the_velocity_log_are_undone_first(raw, vehicle):
    log = (
        {"name": "sensor_scale", "s": 0.05},
        {"name": "sensor_lever_arm", "r": [0.4, -0.2, 0.3]},
        {"name": "sensor_delay", "d": 0.03},
    )
    flawed = with_effects(vehicle, *DAMPING, *log)
    logged, true = simulate(flawed, raw), simulate(with_effects(vehicle, *DAMPING), raw)
    assert np.abs(logged["u"].to_numpy() - true["u"].to_numpy()).max() > 0.01
    known, ignored = (residual(labels(v, logged, design=SPLINE)) for v in (flawed, vehicle))
    expected = residual(labels(vehicle, true, design=SPLINE))
    assert np.abs(known - expected)[20:-20].max() < 0.2
    assert np.abs(ignored - expected)[20:-20].max() > 2.0


def test_wrong_vehicle(raw, vehicle):
    six = msgspec.structs.replace(vehicle, thruster=vehicle.thruster[:6])
    with pytest.raises(
        DataError, match="8 command columns, also cmd_7, and vehicle synthetic 6 thrusters; use the vehicle"
    ):
        labels(six, raw)


def test_rows_alone_between_gaps(raw, vehicle):
    lonely = pl.concat([raw[:50], raw[60:61], raw[70:]])
    with pytest.raises(DataError, match=r"1 rows stand alone.*row 50, session synthetic-0"):
        labels(vehicle, lonely)


@pytest.mark.parametrize(("column", "value"), [("u", math.nan), ("phi", math.inf), ("cmd_3", math.nan)])
def test_values_that_are_not_finite(raw, vehicle, column, value):
    broken = raw.with_columns(
        pl.when(pl.int_range(pl.len()) == 200).then(value).otherwise(pl.col(column)).alias(column)
    )
    with pytest.raises(DataError, match=r"not finite in .* session synthetic-0"):
        labels(vehicle, broken)


@pytest.fixture(scope="module")
def stonefish_labels(stonefish) -> pl.DataFrame:
    raw = pl.read_parquet(stonefish / "nominal_test.parquet")
    known, _ = vehicle_file.read(
        Path(__file__).resolve().parents[3] / "datasets" / "stonefish" / "vehicle.toml"
    )
    return labels(known, raw)


def test_stonefish_residual_takes_energy(stonefish_labels):
    """tau_res opposes motion: nu . tau_res > 0 (D dissipates) wherever the vehicle moves."""
    nu = stonefish_labels.select(VELOCITY).to_numpy().astype(float)
    power = np.sum(nu * residual(stonefish_labels), axis=1)
    moving = np.linalg.norm(nu[:, :3], axis=1) > 0.2
    assert (power[moving] > 0).mean() > 0.99


def test_stonefish_labels_are_smooth(stonefish_labels):
    """Third differences, which leave noise only: typically below 0.01 N, where forces reach hundreds."""
    jumps = np.diff(residual(stonefish_labels), n=3, axis=0) / math.sqrt(20)
    assert (np.median(np.abs(jumps), axis=0) < 0.01).all()
    assert (np.abs(residual(stonefish_labels)).max(axis=0)[:3] > 300).all()
