"""The page in a browser: the sample from the log to the saved file, and what goes wrong on the way."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browser import CHROMIUM, Page, page

from hydro.app.desk import Desk
from hydro.app.opening import Craft, presets
from hydro.app.places import Places
from hydro.app.server import application, bound
from hydro.app.worker import Report, Worker
from hydro.core.explanation.explain import BEST, explain
from hydro.io import covariance
from hydro.io import vehicle as vehicles
from hydro.io.study import Study
from hydro.io.table import Artefact

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
ERROR = "document.getElementById('error').textContent"
RUNGS = "[...document.querySelectorAll('.rung')].map(one => one.querySelector('.name').textContent)"
DRAWN = "Number(document.body.dataset.drawn || 0)"


class InThread(Worker):
    """Worker without a process of its own, so that the tests share compiled kernels."""

    def run(self, work: Any, *arguments: Any, report: Report | None = None) -> Any:
        return work(*arguments, report or (lambda kind, content: None))


@pytest.fixture(scope="module")
def desk(folder: Path) -> Desk:
    places = Places.of([folder])
    return Desk(
        places, str(folder / "vehicle.toml"), [str(folder / "short.parquet")], "", 10**6, worker=InThread
    )


@pytest.fixture(scope="module")
def link(desk: Desk) -> Iterator[str]:
    import uvicorn

    address, listening = bound("127.0.0.1", 0, None)
    guarded = application(desk, address)
    server = uvicorn.Server(uvicorn.Config(guarded, log_level="error", ws="websockets-sansio"))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]}, daemon=True)
    thread.start()
    while not server.started:
        assert thread.is_alive()
        time.sleep(0.02)
    yield address.link
    server.should_exit = True
    thread.join(20.0)
    desk.close()


@pytest.fixture(scope="module")
def tab(link: str) -> Iterator[Page]:
    with page() as opened:
        opened.seconds = 90.0
        opened.screen(1280, 800)
        opened.visit(link, "document.querySelector('.bench') !== null")
        opened.wait(f"{DRAWN} >= 2")
        yield opened


def click(tab: Page, words: str) -> None:
    """Click the first button of the panel with these words."""
    found = f"[...document.querySelectorAll('.panel button')].find(one => one.innerText.trim() === '{words}')"
    tab.wait(f"{found} !== undefined && !{found}.disabled")
    tab.run(f"{found}.click()")


def says(tab: Page, words: str) -> None:
    """Wait until the panel has these words."""
    tab.wait(f"document.querySelector('.panel').textContent.includes({json.dumps(words)})")


def warned(tab: Page, words: str) -> None:
    """Wait until the panel has a warning of one line with these words."""
    tab.wait(f"document.querySelector('.said.warning')?.textContent.includes({json.dumps(words)}) ?? false")
    assert "\n" not in tab.run("document.querySelector('.said.warning').textContent")


def choose(tab: Page, title: str, words: str) -> None:
    """Choose an item of the menu below a title of the panel."""
    heading = (
        f"[...document.querySelectorAll('.panel h3')].find(one => one.textContent.startsWith('{title}'))"
    )
    tab.run(f"{heading}.parentElement.nextElementSibling.click()")
    item = (
        f"[...document.querySelectorAll('.q-menu .q-item')].find(one => one.innerText.trim() === '{words}')"
    )
    tab.wait(f"{item} !== undefined")
    tab.run(f"{item}.click()")


def unfold(tab: Page, title: str) -> None:
    """Open a part of the panel that is folded."""
    part = "[...document.querySelectorAll('.panel .q-expansion-item')]"
    head = f"{part}.find(one => one.innerText.startsWith('{title}')).querySelector('.q-item')"
    tab.run(f"{head}.click()")
    body = f"{head}.parentElement.querySelector('.q-expansion-item__content')"
    tab.wait(f"{body}.clientHeight > 0")
    time.sleep(0.4)  # it moves while it opens


def upload(tab: Page, name: str, text: str) -> None:
    tab.run(f"workbench.upload([new File([{json.dumps(text)}], {json.dumps(name)})])")


def test_the_sample_goes_from_the_log_to_the_file_that_explain_writes(
    tab: Page, desk: Desk, folder: Path, craft: Craft, short: Artefact, other: Artefact
) -> None:
    says(tab, "800 rows at 25 Hz in 2 sessions")
    assert "token" not in tab.run("location.href")
    unfold(tab, "Optional")
    choose(tab, "Held-out recording", "other.parquet")
    click(tab, "Open")
    says(tab, "held-out recording: 400 rows at 25 Hz in 1 session")
    given = float(tab.run(ERROR))

    tab.press("2")
    says(tab, "Error over 6 predictions")
    tab.wait("document.querySelector('.place') !== null")
    tab.run("document.querySelector('.place').click()")
    tab.wait("workbench.state().cursor > 0 || workbench.state().window[0] > 0")
    before = tab.run("workbench.state().cursor")
    tab.press("ArrowRight")
    assert tab.run("workbench.state().cursor") == pytest.approx(before + 1.0)
    tab.press(" ")
    tab.wait(f"workbench.state().cursor > {before + 1.05}")
    tab.press(" ")
    assert tab.run("workbench.state().playing") is False

    tab.press("3")
    click(tab, "Diagnose")
    tab.wait("document.querySelector('.card') !== null")
    session = next(iter(desk.tabs.values())).session
    effect = session.findings[0]["effect"]
    click(tab, "Add")
    tab.wait(f"{RUNGS}.length === 2")
    assert float(tab.run(ERROR)) < given

    tab.press("4")
    tab.wait("document.querySelector('input[data-slide]') !== null")
    drawn, here = tab.run(DRAWN), tab.run(ERROR)
    slide = "var one = document.querySelector('input[data-slide]'); one.value = one.max;"
    tab.run(f"{slide} one.dispatchEvent(new Event('input', {{bubbles: true}}))")
    tab.wait(f"{DRAWN} > {drawn} && {ERROR} !== '{here}'")
    assert len(tab.run(RUNGS)) == 2
    tab.run(f"{slide} one.dispatchEvent(new Event('change', {{bubbles: true}}))")
    tab.wait(f"{RUNGS}.length === 3")
    tab.press("z", modifiers=2)
    tab.wait(f"{ERROR} === '{here}'")

    tab.press("5")
    (wanted,) = session.history[1].wanted
    assert wanted in (effect, BEST), "the card adds its finding, by its name or as the best one"
    beside = f"--holdout {folder}/other.parquet"
    says(
        tab, f"hydro explain {folder}/vehicle.toml {folder}/short.parquet {beside} --add {wanted} -o study-1"
    )
    click(tab, "Save")
    says(tab, f"saved {folder}/vehicle-new.toml")
    click(tab, "Save with report")
    says(tab, f"saved {folder}/study, {folder}/study.html")
    assert tab.complaints == []
    assert [
        one
        for one in tab.requests
        if not one.startswith(("http://127.0.0.1", "ws://127.0.0.1", "data:", "blob:"))
    ] == []

    told = {"add": [wanted]}
    study = Study(folder / "study", craft.text, short, other, (), told)
    done = study.done()
    assert len(done) == 2
    assert study.has_ended(done)
    done = session.rung.steps[:1]
    (last,) = explain(craft.vehicle, short.frame, holdout=other.frame, done=done, wanted=[wanted])
    saved, text = vehicles.read(folder / "vehicle-new.toml")
    assert text == (folder / "study" / "vehicle-1.toml").read_text()
    for table in last.tables:
        written = saved.effects(table["name"])[0]
        for key, value in table.items():
            if key not in ("name", "standard_error") and value is not None:
                assert written[key] == pytest.approx(value, rel=1e-6)
    estimates, warning = covariance.read(folder / "vehicle-new.toml", saved)
    assert warning == ""
    assert len(estimates.entries) == len(last.estimates.entries)


NAMES = {
    "t": "Zeit",
    "x": "Nord",
    "y": "Ost",
    "z": "Tiefe",
    "phi": "Krängung",
    "theta": "Trimm",
    "psi": "Kurs",
}
"""Names of columns in a log that no rule knows."""


def named(tab: Page, sensor: str, *columns: str) -> None:
    """Name the columns of a sensor in the map by clicks on them."""
    row = f"[...document.querySelectorAll('.panel .map')].find(one => one.innerText.startsWith('{sensor}'))"
    field = f"{row}.querySelector('input')"
    tab.run(f"{field}.focus()")
    for column in columns:
        word = f"[...document.querySelectorAll('.columns span')].find(one => one.textContent === '{column}')"
        tab.run(f"{word}.dispatchEvent(new MouseEvent('mousedown', {{bubbles: true, cancelable: true}}))")
    tab.run(f"{field}.blur()")
    tab.wait(f"{row}.querySelector('.q-select') !== null")


def test_columns_with_unknown_names_are_named_by_clicks_and_the_map_is_kept(
    tab: Page, folder: Path, short: Artefact
) -> None:
    commands = [name for name in short.frame.columns if name.startswith("cmd_")]
    velocities = dict(zip("uvwpqr", ("vor", "quer", "tief", "wx1", "wy1", "wz1"), strict=True))
    names = NAMES | velocities | {one: f"Kanal{number}" for number, one in enumerate(commands, 1)}
    log = short.frame.filter(session="run-1").select(*names).rename(names)
    tab.press("1")
    upload(tab, "tauchgang.csv", log.write_csv())
    says(tab, "tauchgang.csv")
    click(tab, "Open")
    warned(tab, "no columns are recognised as")
    named(tab, "time", "Zeit")
    named(tab, "commands", *(names[one] for one in commands))
    named(tab, "position", "Nord", "Ost", "Tiefe")
    named(tab, "attitude", "Krängung", "Trimm", "Kurs")
    named(tab, "velocity", "vor", "quer", "tief")
    named(tab, "rates", "wx1", "wy1", "wz1")
    click(tab, "Open")
    says(tab, "Understood: tauchgang.csv")
    click(tab, "Next: 2 Compare")
    says(tab, "Error over")
    tab.screen(390, 844)
    tab.wait("document.documentElement.scrollWidth <= 390")
    assert tab.run("document.getElementById('curves').getBoundingClientRect().height") > 300
    tab.screen(1280, 800)
    (folder / "map.toml").write_text("another map")
    tab.press("5")
    click(tab, "Save")
    says(tab, "--map " + str(folder / "map-tauchgang.toml"))
    assert (folder / "map.toml").read_text() == "another map"


def test_a_click_on_a_button_that_the_server_has_replaced_counts(tab: Page, desk: Desk) -> None:
    tab.press("1")
    says(tab, "Next: 2 Compare")
    found = "[...document.querySelectorAll('.panel button')].find(one => one.innerText.startsWith('Next'))"
    tab.run(f"window.old = {found}; window.updates = window.socket.listeners('update').slice(); null")
    tab.run("updates.forEach(one => window.socket.off('update', one))")
    (shown,) = (one for one in desk.tabs.values() if one.owner)
    for act, step in (("press 2", 2), ("press 1", 1), ("old.click()", 2)):
        tab.press(act[-1]) if act.startswith("press") else tab.run(act)
        end = time.monotonic() + tab.seconds
        while shown.step != step:
            assert time.monotonic() < end, act
            time.sleep(0.02)
    tab.visit(tab.run("location.href"), f"window.workbench !== undefined && {DRAWN} === 1")
    says(tab, "Error over")


def test_the_table_of_errors_follows_the_horizon(tab: Page) -> None:
    tab.press("2")
    says(tab, "Error over")
    table = "document.querySelector('.panel .table').innerText"
    before = tab.run(table)
    click(tab, "1 s")
    tab.wait(f"{table} !== {json.dumps(before)}")
    click(tab, "5 s")
    tab.wait(f"{table} === {json.dumps(before)}")


def test_a_wrong_vehicle_and_a_bad_log_show_a_line_and_the_page_lives(tab: Page, folder: Path) -> None:
    rungs = tab.run(RUNGS)
    tab.press("1")
    upload(tab, "fewer.toml", Path(presets()["remus100"]).read_text())
    says(tab, "fewer.toml")
    click(tab, "Open")
    warned(tab, "thrusters")
    upload(tab, "broken.mcap", "no log")
    says(tab, "broken.mcap")
    click(tab, "Open")
    warned(tab, "broken.mcap")
    upload(tab, "..%2Fetc.csv", "t")
    tab.wait("document.body.innerText.includes('file name')")
    assert tab.run(RUNGS) == rungs
    tab.visit(tab.run("location.href"), f"window.workbench !== undefined && {DRAWN} === 1")
    assert tab.run(RUNGS) == rungs
    tab.press("2")
    says(tab, "Error over")
