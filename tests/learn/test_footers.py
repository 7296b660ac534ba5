"""Damaged metadata of network files: a one-line error, or a valid network."""

from __future__ import annotations

import copy

import msgspec
import numpy as np
import pytest
from fuzz.mutations import JUNK, places
from sim.trained import trained

from hydro.core.distillation.features import names
from hydro.core.errors import DataError
from hydro.core.residual.network import Network
from hydro.io.model import Model, from_artefact, to_artefact
from hydro.io.table import Artefact
from hydro.learn.networks import ARCHITECTURES, inputs, load

SMALL = {
    "mlp": {"layers": [12, 4, 6]},
    "physfeat": {"layers": [45, 4, 6]},
    "resmlp": {"width": 4, "hidden": 3, "blocks": 2},
    "multihead": {"trunk": [12, 4, 5], "head": 3},
    "moe": {"experts": 2, "layers": [12, 4, 6], "gate": [12, 3, 2]},
    "structured": {"layers": [7, 4, 36]},
    "temporal": {"layers": [54, 4, 6]},
    "gp": {"points": 4},
}
"""Sizes with which a network is built in no time."""
LOST = object()


def artefact(name: str) -> Artefact:
    _, made = trained(name, **SMALL[name])
    said = inputs(made.architecture)
    return to_artefact(
        Model(
            name=name,
            architecture=made.architecture,
            tensors=made.tensors,
            features=made.architecture["features"],
            scalers=made.scalers,
            inputs=said,
            outputs=tuple("XYZKMN"),
            units=dict.fromkeys(said, "m/s"),
        )
    )


def changed(sound: Artefact, place: tuple, value: object) -> Artefact:
    """Return the artefact with another value at one place of the network description in its footer."""
    said = copy.deepcopy(dict(sound.provenance.model or {}))
    home = said
    for key in place[:-1]:
        home = home[key]
    if value is LOST:
        del home[place[-1]]
    else:
        home[place[-1]] = value
    record = msgspec.structs.replace(sound.provenance, model=said)
    return Artefact(sound.kind, sound.frame, record)


def test_all_networks_are_tried() -> None:
    assert SMALL.keys() == ARCHITECTURES.keys()


@pytest.mark.parametrize("name", list(SMALL))
def test_an_architecture_with_anything_else_in_it_is_built_or_refused(name: str) -> None:
    sound = artefact(name)
    Network.of(from_artefact(sound))
    load(from_artefact(sound))
    refused = []
    for place in places({"architecture": (sound.provenance.model or {})["architecture"]}):
        for value in (*(one for one in JUNK if not isinstance(one, float) or np.isfinite(one)), LOST):
            for use in (Network.of, load):
                try:
                    use(from_artefact(changed(sound, place, value)))
                except DataError as error:
                    refused.append(str(error))
    assert len(refused) > 100
    assert all(len(line) > 20 and "\n" not in line for line in refused)


def test_a_number_in_the_place_of_widths_is_named() -> None:
    wrong = changed(artefact("mlp"), ("architecture", "layers"), 3)
    with pytest.raises(DataError, match=r"Expected `array`, got `int` - at `\$.architecture.layers`"):
        from_artefact(wrong)


def test_a_window_without_its_period_is_named() -> None:
    with pytest.raises(DataError, match="a window without its period: train it again"):
        from_artefact(changed(artefact("temporal"), ("architecture", "period"), LOST))


def test_other_features_than_the_scalers_are_named() -> None:
    wrong = from_artefact(changed(artefact("mlp"), ("architecture", "features"), "physfeat"))
    with pytest.raises(DataError, match=f"scalers have 12 inputs .* has {len(names('physfeat'))} and 6"):
        Network.of(wrong)


def test_what_other_networks_ask_for_is_kept() -> None:
    sound = artefact("mlp")
    said = from_artefact(changed(sound, ("architecture", "groups"), [1, 2]))
    assert said.architecture["groups"] == [1, 2]
