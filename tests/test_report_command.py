"""`report`: the page in a real browser, and the command around it."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import browser
import polars as pl
import pytest
import studies
from PIL import Image
from streams_here import piped

from hydro import cli
from hydro.io import table

SCREENS = 6
"""Screens of a phone that the page may take, with its details folded."""
CHARTS = 1 + 6 + 3 + 7 + 6 + 3
"""Of the study: by condition, unexplained force on each axis, values of two effects in three units, the
ladder of all axes and each, overlays, path, depth and commands."""


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return studies.write(tmp_path_factory.mktemp("study"))


@pytest.fixture(scope="module")
def report(study: Path) -> Path:
    path = study / "report.html"
    assert cli.main(["report", str(study), "-o", str(path), "--pictures", str(study / "pictures")]) == 0
    return path


@pytest.fixture(scope="module")
def page() -> Iterator[browser.Page]:
    if browser.CHROMIUM is None:
        pytest.skip("no chromium on this machine: `make browser` installs it")
    with browser.page() as opened:
        yield opened


# In a browser.


@pytest.mark.parametrize(
    ("width", "height", "dark", "touch"), [(1200, 900, False, False), (390, 844, True, True)]
)
def test_the_page_renders(
    page: browser.Page, report: Path, width: int, height: int, dark: bool, touch: bool
) -> None:
    page.screen(width, height, dark=dark, touch=touch)
    page.complaints.clear()
    page.requests.clear()
    page.open(report)
    assert page.run("document.documentElement.scrollHeight") <= SCREENS * 844
    page.unfold()
    drawn = page.run(
        "[...document.querySelectorAll('.js-plotly-plot')].map(p => p.querySelectorAll('path').length)"
    )
    assert len(drawn) == CHARTS
    assert min(drawn) > 0
    assert page.complaints == []
    assert page.requests == [report.as_uri()]
    assert page.run("document.documentElement.scrollWidth") <= width
    right = "[...document.querySelectorAll('.js-plotly-plot')].map(p => p.getBoundingClientRect().right)"
    assert max(page.run(right)) <= width
    tables = "[...document.querySelectorAll('.scroll')].map(box => box.scrollWidth - box.clientWidth)"
    assert max(page.run(tables)) <= 1
    folded = page.run("document.querySelectorAll('table.folded td[data-name]').length")
    assert (folded > 0) is (width < 500)
    paper = page.run("getComputedStyle(document.body).backgroundColor")
    assert (paper == "rgb(19, 22, 26)") is dark


def test_selectors_in_the_page_change_the_figures(page: browser.Page, report: Path) -> None:
    page.screen(1200, 900)
    page.open(report)
    shown = "document.getElementById('ladder-all').data[1].y"
    assert page.run(shown) == pytest.approx([2.0, 0.2])
    page.run(
        "(async () => { const s = document.querySelector('select[data-group=horizon]'); s.value = 0;"
        " s.dispatchEvent(new Event('change')); await new Promise(done => setTimeout(done, 300)); })()"
    )
    assert page.run(shown) == pytest.approx([0.4, 0.04])


def test_texts_from_files_are_escaped_in_html(page: browser.Page, tmp_path: Path) -> None:
    evil = "</script><script>document.title='evil'</script><img src=x onerror=\"document.title='evil'\">"
    frame = studies.replay(("measured", evil)).with_columns(pl.col("session").replace("run-1", evil))
    table.write(table.make("replay", frame, stage="replay"), tmp_path / "replay.parquet")
    assert cli.main(["report", str(tmp_path / "replay.parquet"), "-o", str(tmp_path / "page.html")]) == 0
    page.complaints.clear()
    page.screen(390, 844)
    page.open(tmp_path / "page.html")
    assert page.run("document.title") == "Report · hydro report"
    assert page.run("document.querySelectorAll('img').length") == 0
    assert page.run("document.querySelector('select').options[0].text") == evil
    assert page.complaints == []
    assert page.run("document.documentElement.scrollWidth") <= 390


# The command.


def test_figures_are_written_as_pictures(report: Path) -> None:
    folder = report.parent / "pictures"
    assert {one.stem for one in folder.iterdir()} == {"places", "findings", "ladder", "replay"}
    for one in folder.iterdir():
        colours = Image.open(one).convert("RGB").getcolors(1 << 24)
        assert colours is not None
        assert len(colours) > 50


def test_a_pipe_gives_the_same_page(study: Path, tmp_path: Path) -> None:
    source = study / "comparison-0.parquet"
    done = piped("report", stdin=source.read_bytes())
    assert done.returncode == 0
    assert cli.main(["report", str(source), "-o", str(tmp_path / "page.html")]) == 0
    page = (tmp_path / "page.html").read_text()
    assert done.stdout.decode().replace("<b>stdin</b>", f"<b>{source}</b>") == page


@pytest.mark.parametrize(
    ("place", "told"),
    [
        ("empty", "no comparison, diagnosis, ladder, replay or metrics in this folder"),
        ("missing.parquet", "no such file"),
        ("raw.parquet", "a raw table, but this needs comparison or diagnosis"),
        ("notes.parquet", "not a Parquet file"),
    ],
)
def test_bad_input_gives_a_one_line_error(
    tmp_path: Path, datasets: Path, place: str, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "notes.parquet").write_text("notes")
    with contextlib.suppress(FileExistsError):
        (tmp_path / "raw.parquet").symlink_to(datasets / "stonefish" / "replay90.parquet")
    assert cli.main(["report", str(tmp_path / place), "-o", str(tmp_path / "page.html")]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line
    assert str(tmp_path / place) in line
    assert not (tmp_path / "page.html").exists()
