"""Draw docs/images/report.png, two parts of the report of the README's study; `make docs` runs it.

A study of the bundled recording is made, or that of a folder is used: python docs/draw_report.py [STUDY].
Without Chromium the picture stays as it is.
"""

from __future__ import annotations

import base64
import io
import sys
import tempfile
from pathlib import Path

from PIL import Image

from hydro import cli

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))
import browser  # noqa: E402

PICTURE = ROOT / "docs" / "images" / "report.png"
HIDDEN = ROOT / "datasets" / "hidden"
WIDTH, HEIGHT, BETWEEN = 600, 980, 20
"""Size of a part and width of the line between the parts [pixels]."""


def study(folder: Path) -> Path:
    """Explain the bundled recording and return the folder of the study."""
    files = [str(HIDDEN / name) for name in ("vehicle.toml", "measured.parquet")]
    held_out = str(HIDDEN / "heldout.parquet")
    if cli.main(["explain", *files, "--holdout", held_out, "-o", str(folder)]):
        raise SystemExit("docs/draw_report.py: hydro explain failed")
    return folder


def drawn(page: Path) -> Image.Image:
    """Return the top of a report, and its unexplained forces, side by side."""
    whole = Image.new("RGB", (2 * WIDTH + BETWEEN, HEIGHT), "#d4d6d2")
    with browser.page() as tab:
        tab.screen(WIDTH, HEIGHT)
        tab.open(page)
        whole.paste(shot(tab, 0.0), (0, 0))
        tab.unfold()
        top = tab.run("document.getElementById('leftover').getBoundingClientRect().top + scrollY")
        whole.paste(shot(tab, top), (WIDTH + BETWEEN, 0))
    return whole


def shot(tab: browser.Page, top: float) -> Image.Image:
    """Return a part of a page that begins at a height [pixels]."""
    clip = {"x": 0, "y": top, "width": WIDTH, "height": HEIGHT, "scale": 1}
    taken = tab.call("Page.captureScreenshot", format="png", captureBeyondViewport=True, clip=clip)
    return Image.open(io.BytesIO(base64.b64decode(taken["data"]))).convert("RGB")


def main() -> None:
    """Draw the picture."""
    if browser.CHROMIUM is None:
        print("docs/draw_report.py: no chromium: docs/images/report.png stays as it is (`make browser`)")
        return
    with tempfile.TemporaryDirectory() as folder:
        source = Path(sys.argv[1]) if sys.argv[1:] else study(Path(folder) / "study")
        page = Path(folder) / "report.html"
        if cli.main(["report", str(source), "-o", str(page)]):
            raise SystemExit("docs/draw_report.py: hydro report failed")
        drawn(page).quantize(256).save(PICTURE, optimize=True)


if __name__ == "__main__":
    main()
