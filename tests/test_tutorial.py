"""docs/tutorial.md and docs/dive.md show what their commands print."""

from __future__ import annotations

import math
import re
import runpy
from pathlib import Path

import forked
import pytest

DOCS = Path(__file__).resolve().parents[1] / "docs"
GENERATOR = runpy.run_path(str(DOCS / "generate_tutorial.py"))
TEXT = (DOCS / "tutorial.md").read_text()
NUMBER = re.compile(r"(?<![\w.])-?\d[\d,]*(?:\.\d+)?(?:e[+-]?\d+)?")
ROUNDING = 0.05
"""How far numbers may be apart: computers differ in the last figures, and networks more than that."""
NOTHING = 1e-4
"""What is as good as 0."""


def words_and_numbers(text: str) -> tuple[list[str], list[float]]:
    """A text's words without blanks and rules, and its numbers."""
    numbers = [float(number.replace(",", "")) for number in NUMBER.findall(text)]
    return re.sub("─+", "", NUMBER.sub("#", text)).split(), numbers


def errors_of_network(page: str, *, rest: bool = False) -> list[float]:
    """Return the numbers of a page's rows about a trained network, or those of all other rows."""
    rows = [line for line in page.splitlines() if line.startswith("effects+MJ4 ") != rest]
    return words_and_numbers("\n".join(rows))[1]


@pytest.mark.slow
@pytest.mark.parametrize("path", GENERATOR["PAGES"], ids=lambda path: path.stem)
def test_a_page_shows_what_its_commands_print(path: Path) -> None:
    text = path.read_text()
    pages = (text, GENERATOR["page"](text, forked.program()))
    shown, printed = (words_and_numbers(page)[0] for page in pages)
    assert printed == shown, "run `make docs`"
    kept, found = (errors_of_network(page, rest=True) for page in pages)
    assert found == pytest.approx(kept, rel=ROUNDING, abs=NOTHING), "run `make docs`"
    for one, other in zip(*map(errors_of_network, pages), strict=True):
        assert max(one, other) < 3.0 * min(one, other), (
            "processors train a network differently, by up to 2.3 times"
        )


def test_the_dive_ends_with_what_hides_in_it() -> None:
    """The page says what `datasets/dive.py` hid: the numbers come from its commands, the truth from there."""
    from dive import HIDDEN

    gain, current = HIDDEN
    shown = " ".join((DOCS / "dive.md").read_text().split())
    thruster, share = re.search(r"Thruster (\d) delivers (\d+) % ", shown).groups()
    weak = min(range(len(gain["g"])), key=lambda i: gain["g"][i])
    assert int(thruster) == weak + 1
    assert int(share) == pytest.approx(100.0 * (1.0 + gain["g"][weak]), abs=2.0)
    speed, heading = re.search(r"A current of ([\d.]+) m/s \S+ flows toward (\d+)°", shown).groups()
    assert float(speed) == pytest.approx(math.hypot(current["v_N"], current["v_E"]), abs=0.01)
    toward = math.degrees(math.atan2(current["v_E"], current["v_N"])) % 360.0
    assert float(heading) == pytest.approx(toward, abs=3.0)


def test_a_stale_figure_is_seen() -> None:
    stale = re.sub(r"Without it \d+ %", "Without it 12 %", TEXT)
    assert stale != TEXT
    words, numbers = words_and_numbers(stale)
    assert words == words_and_numbers(TEXT)[0]
    assert numbers != pytest.approx(words_and_numbers(TEXT)[1], rel=ROUNDING)


def test_an_excerpt_keeps_its_parts() -> None:
    printed = "a 1\nb 2\nc 3\nd 4\ne 5\nf 6\n"
    assert GENERATOR["excerpt"](printed, "x\n…\nd 9\ne 9\n…\ny\n") == "a 1\n…\nd 4\ne 5\n…\nf 6\n"
    assert GENERATOR["excerpt"](printed, "…\ny\ny\n") == "…\ne 5\nf 6\n"
    assert GENERATOR["excerpt"](printed, "anything\n") == printed
    with pytest.raises(ValueError, match="begins with 'z'"):
        GENERATOR["excerpt"](printed, "…\nz\n…\n")
