"""Files that are almost right, through every command: exit code 0, 1 or 2, and one line that helps, always.

`make fuzz` tries for some minutes what every run of the tests tries a few dozen times.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from fuzz import workshop
from fuzz.mutations import damaged, mutated, spoilt
from fuzz.workshop import SPOILT, Workshop
from hydro.io.provenance import content_hash

CASES = int(os.environ.get("HYDRO_FUZZ", "20"))
GENERATORS = st.integers(0, 2**32).map(np.random.default_rng)
TRIED = settings(
    max_examples=CASES,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    phases=[Phase.explicit, Phase.generate, Phase.shrink],
)


@pytest.fixture(scope="module")
def shop(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Workshop]:
    here = Path.cwd()
    made = Workshop(tmp_path_factory.mktemp("fuzz"))
    yield made
    os.chdir(here)
    print("\nfuzz:", ", ".join(f"{kind} {count}" for kind, count in sorted(made.counts.items())))


@TRIED
@given(st.data())
def test_vehicle_files(shop: Workshop, data: st.DataObject) -> None:
    path = shop.toml(data.draw(mutated(shop.vehicle)))
    shop.hold("vehicle", data.draw(st.sampled_from(workshop.VEHICLE)), path)


@TRIED
@given(st.data())
def test_maps(shop: Workshop, data: st.DataObject) -> None:
    path = shop.toml(data.draw(mutated(shop.map)))
    shop.hold("map", data.draw(st.sampled_from(workshop.MAP)), path)


@TRIED
@given(st.data())
def test_tables(shop: Workshop, data: st.DataObject) -> None:
    kind = data.draw(st.sampled_from(sorted(workshop.TABLES)))
    frame = data.draw(spoilt(shop.table(kind)))
    known = {**shop.footer(kind), "content": content_hash(frame)} if data.draw(st.booleans()) else None
    path = shop.parquet(kind, frame, known)
    shop.hold("table", data.draw(st.sampled_from((*workshop.TABLES[kind], *workshop.ALWAYS))), path)


@TRIED
@given(st.data())
def test_footers(shop: Workshop, data: st.DataObject) -> None:
    kind = data.draw(st.sampled_from(sorted(workshop.TABLES)))
    path = shop.parquet(kind, None, data.draw(mutated(shop.footer(kind))))
    shop.hold("footer", data.draw(st.sampled_from((*workshop.TABLES[kind], *workshop.ALWAYS))), path)


@TRIED
@given(st.data())
def test_logs(shop: Workshop, data: st.DataObject) -> None:
    path = shop.folder / "spoilt.csv"
    path.write_bytes(damaged((shop.folder / "log.csv").read_bytes(), data.draw(GENERATORS)))
    shop.hold("log", data.draw(st.sampled_from(workshop.LOG)), path)


@TRIED
@given(st.data())
def test_bytes_of_tables(shop: Workshop, data: st.DataObject) -> None:
    kind = data.draw(st.sampled_from(sorted(workshop.TABLES)))
    path = shop.folder / "spoilt.parquet"
    sound = (shop.folder / f"{kind}.parquet").read_bytes()
    path.write_bytes(damaged(sound, data.draw(GENERATORS)))
    shop.hold("bytes", data.draw(st.sampled_from((*workshop.TABLES[kind], *workshop.ALWAYS))), path)


def test_what_is_no_help_is_seen(shop: Workshop, monkeypatch: pytest.MonkeyPatch) -> None:
    """The check can fail: an exit code of 3, a traceback, a file left behind."""
    path = shop.toml(shop.vehicle)
    for code, said in ((3, "hydro: KeyError: this is a bug"), (1, "Traceback"), (1, ""), (1, "hydro: no")):
        monkeypatch.setattr(shop, "run", lambda line, code=code, said=said: (code, said))
        with pytest.raises(AssertionError):
            shop.hold("none", f"check {SPOILT}", path)

    def littered(line: str) -> tuple[int, str]:
        (shop.folder / "litter.tmp").touch()
        return 1, "hydro: spoilt.toml: mass: missing"

    monkeypatch.setattr(shop, "run", littered)
    with pytest.raises(AssertionError, match="litter"):
        shop.hold("none", f"check {SPOILT}", path)
