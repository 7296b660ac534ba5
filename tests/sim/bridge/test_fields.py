"""Offsets of MuJoCo's fields: correct for this version, and refused if they differ."""

from __future__ import annotations

import ctypes

import mujoco
import pytest

from hydro.core.errors import HydroError
from hydro.sim.bridge import fields, structs


def test_a_number_read_through_its_offset_is_the_number():
    model = mujoco.MjModel.from_xml_string("<mujoco><option timestep='0.125' viscosity='0.5'/></mujoco>")
    for name in ("timestep", "viscosity"):
        at = model._address + fields.offset("mjModel", f"opt.{name}")
        assert ctypes.c_double.from_address(at).value == getattr(model.opt, name)


def test_every_field_that_the_callbacks_use_is_verified():
    fields.verify({"mjModel": structs.MODEL_FIELDS, "mjData": structs.DATA_FIELDS})


@pytest.mark.parametrize(
    ("struct", "field"), [("mjData", "qvel"), ("mjModel", "opt.timestep"), ("mjData", "time")]
)
def test_a_struct_laid_out_otherwise_is_refused(monkeypatch, struct, field):
    find = fields._find

    def shifted(owner, name):
        at, kind = find(owner, name)
        return (at + 8, kind) if (owner, name) == (struct, field) else (at, kind)

    monkeypatch.setattr(fields, "_find", shifted)
    with pytest.raises(HydroError, match=rf"{struct}\.{field}.*install mujoco 4\.0"):
        fields.verify({struct: (field,)})


def test_an_unknown_field_is_refused():
    with pytest.raises(HydroError, match=r"no field mjData\.nonsense"):
        fields.offset("mjData", "nonsense")
