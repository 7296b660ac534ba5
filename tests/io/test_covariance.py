"""A covariance beside a file: back and forth, in part, joined, and ignored where the file says otherwise."""

from __future__ import annotations

import msgspec
import numpy as np
import polars as pl
import pytest

from hydro.core.effects import CATALOGUE
from hydro.core.errors import DataError
from hydro.core.identification.prior import deviations
from hydro.core.prediction.parameters import free
from hydro.core.simulation.estimates import Estimate, Estimates
from hydro.io import covariance, table
from hydro.io import vehicle as files
from hydro.io.files import bundled


@pytest.fixture(scope="module")
def auv():
    return files.read(bundled("vehicles") / "auv151.toml")


def of_drag(vehicle) -> Estimates:
    drag = vehicle.effects("linear_damping")[0]["diagonal"]
    entries = tuple(Estimate("linear_damping", "diagonal", (i,), "N s/m", drag[i]) for i in range(3))
    root = np.array([[2.0, 0.0, 0.0], [1.0, 3.0, 0.0], [-1.0, 0.5, 4.0]])
    return Estimates(entries, root @ root.T)


def written(folder, auv) -> tuple:
    vehicle, text = auv
    path = folder / "vehicle.toml"
    path.write_text(text)
    covariance.write(of_drag(vehicle), path, stage="fit", inputs=(), vehicle_text=text)
    return path, vehicle, text


def test_what_is_written_is_read(tmp_path, auv):
    path, vehicle, text = written(tmp_path, auv)
    found, warning = covariance.read(path, vehicle)
    assert (tmp_path / "vehicle.covariance.parquet").exists()
    assert warning == ""
    assert found.entries == of_drag(vehicle).entries
    np.testing.assert_allclose(found.covariance, of_drag(vehicle).covariance, rtol=1e-12)
    made = table.read(covariance.beside(path), "covariance").provenance
    assert (made.stage, made.vehicle) == ("fit", text)


def test_a_covariance_of_other_values_is_ignored_and_told(tmp_path, auv):
    path, vehicle, text = written(tmp_path, auv)
    changed = files.set_effect(
        text, {"name": "linear_damping", "diagonal": [15.0, 41.0, 60.0, 5.0, 10.0, 8.0]}
    )
    path.write_text(changed)
    found, warning = covariance.read(path, files.parse(changed))
    assert found is None
    assert "linear_damping.diagonal[1] is 40, but the vehicle file has 41; it is ignored" in warning
    assert covariance.read(path, vehicle.without("linear_damping"))[1].endswith(
        "no such value; it is ignored"
    )
    assert covariance.read(tmp_path / "other.toml", vehicle) == (None, "")


def test_its_errors_are_the_prior_of_a_later_fit(tmp_path, auv):
    path, vehicle, _ = written(tmp_path, auv)
    found, _ = covariance.read(path, vehicle)
    entries = free(vehicle, ["linear_damping"]).entries
    known = deviations(covariance.with_errors(vehicle, found), entries)
    np.testing.assert_allclose(known[:3], of_drag(vehicle).errors)
    np.testing.assert_allclose(known[3:], deviations(vehicle, entries)[3:])


def test_a_part_and_a_later_estimate(auv):
    first = of_drag(auv[0])
    later = Estimates((Estimate("net_buoyancy", "dB", (), "N", 1.0),), np.array([[0.25]]))
    both = later.after(first)
    assert [one.name for one in both.entries][-2:] == ["linear_damping.diagonal[2]", "net_buoyancy.dB"]
    np.testing.assert_array_equal(both.covariance[:3, :3], first.covariance)
    assert not both.covariance[3, :3].any()
    assert both.of_effects(["net_buoyancy"]).entries == later.entries
    assert first.after(both).entries == (*later.entries, *first.entries)


def test_draws_have_the_covariance_and_keep_a_matrix_symmetric(auv):
    vehicle = auv[0]
    drawn = [
        one.effects("linear_damping")[0]["diagonal"][:3] for one in of_drag(vehicle).drawn(vehicle, 4000, 0)
    ]
    np.testing.assert_allclose(np.cov(np.array(drawn).T), of_drag(vehicle).covariance, atol=1.0)
    matrix = np.diag(vehicle.effects("added_mass")[0]["diagonal"]).tolist()
    whole = msgspec.structs.replace(vehicle, effect=({"name": "added_mass", "matrix": matrix},))
    coupling = Estimates((Estimate("added_mass", "matrix", (1, 5), "kg m", 0.0),), np.array([[1.0]]))
    (one,) = coupling.drawn(whole, 1, 0)
    table_ = np.array(one.effect[0]["matrix"])
    assert table_[1, 5] == table_[5, 1] != 0.0
    assert CATALOGUE["added_mass"].parameter("matrix").symmetric


@pytest.mark.parametrize("broken", [[[1.0, 0.5], [0.4, 1.0]], [[1.0], [0.0, 1.0]]])
def test_a_table_that_is_no_covariance_is_refused(tmp_path, broken):
    frame = pl.DataFrame(
        {
            "effect": ["ocean_current"] * 2,
            "parameter": ["v_N", "v_E"],
            "index": pl.Series([[], []], dtype=pl.List(pl.Int64)),
            "unit": ["m/s"] * 2,
            "value": [0.1, 0.2],
            "standard_error": [0.01, 0.02],
            "correlation": broken,
        }
    )
    table.write(table.make("covariance", frame, stage="test"), tmp_path / "v.covariance.parquet")
    with pytest.raises(DataError, match="correlation must"):
        covariance.read(tmp_path / "v.toml")
