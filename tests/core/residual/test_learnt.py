"""What a network says beside a file, against labels of a vehicle that has more than its file."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from recordings import damped, moved

from hydro.core.distillation.labels import labels
from hydro.core.effects.columns import effect_wrenches
from hydro.core.errors import DataError
from hydro.core.recording.arrays import recording
from hydro.core.recording.shots import make_shots
from hydro.core.residual.learnt import Learnt, require_same

EXTRA = {"name": "crossflow_drag", "Cd_y": 0.5, "Cd_z": 0.5}
COLUMNS = [f"{axis}_res" for axis in "XYZKMN"]


class Perfect:
    """A network that says at every row what its label is."""

    memory, period = 0, None

    def __init__(self, said: np.ndarray) -> None:
        self.said = said

    def wrench(self, states: np.ndarray, past: np.ndarray | None = None) -> np.ndarray:
        assert len(states) == len(self.said)
        return self.said


@pytest.mark.parametrize("subtract", ["inertia", "effects"])
def test_less_the_file_a_label_is_what_the_file_lacks(subtract):
    file = damped()
    raw = moved(damped(EXTRA), rows=800)
    said = labels(file, raw, subtract=subtract).select(COLUMNS).to_numpy().astype(float)
    record = recording(file, raw)
    shots = make_shots(record)
    beside = Learnt(Perfect(said), file, subtract != "effects", 1).wrench(file, shots)
    alone = msgspec.structs.replace(file, effect=(EXTRA,))
    true = effect_wrenches(alone, record.eta, record.nu, record.segments, record.t)
    inside = slice(50, -50)
    for axis in (1, 2, 4, 5):
        error = (beside - true)[inside, axis]
        assert np.sqrt(np.mean(error**2)) < 0.1 * np.sqrt(np.mean(true[inside, axis] ** 2))


class Labelled:
    name, subtract, architecture = "net", "inertia", {"window": 1}

    def __init__(self, vehicle) -> None:
        self.labelled = vehicle


def test_a_network_of_another_file_is_refused():
    heavier = damped({"name": "added_mass_coriolis", "kappa": 0.1})
    require_same(Labelled(heavier), damped())  # its forces are all in the label, whatever the file says
    body = msgspec.structs.replace(damped().rigid_body, mass=99.0)
    with pytest.raises(DataError, match="rigid_body"):
        require_same(Labelled(msgspec.structs.replace(damped(), rigid_body=body)), damped())
    with pytest.raises(DataError, match="current"):
        require_same(Labelled(damped()), damped({"name": "ocean_current", "v_N": 0.1}))
