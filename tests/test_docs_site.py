"""The site is built without a complaint, reads on a phone, and asks the network for nothing.

`HYDRO_SITE` names a folder where `make site` has built it already.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import browser
import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built strictly."""
    if there := os.environ.get("HYDRO_SITE"):
        return Path(there).resolve()
    pytest.importorskip("mkdocs", reason="mkdocs is not installed: `make install`")
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", folder],
        cwd=ROOT,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.mark.slow
def test_every_public_function_is_in_the_reference(site: Path) -> None:
    import hydro

    text = (site / "api.html").read_text()
    for name in hydro.__all__:
        assert f'id="hydro.{name}"' in text, name


@pytest.mark.slow
@pytest.mark.skipif(browser.CHROMIUM is None, reason="no chromium")
def test_pages_fit_a_phone_and_need_no_network(site: Path) -> None:
    with browser.page() as page:
        page.screen(390, 800, touch=True)
        for path in sorted(site.glob("*.html")):
            if path.name == "404.html":
                continue
            page.open(path)
            assert page.run("document.documentElement.scrollWidth") <= 390, f"{path.name} scrolls sideways"
        assert [address for address in page.requests if not address.startswith(("file:", "data:"))] == []
