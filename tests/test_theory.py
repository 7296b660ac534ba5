"""docs/theory.md says what the catalogue says, all of it, in tables and links that hold together."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

from hydro.core.effects import CATALOGUE

DOCS = Path(__file__).resolve().parents[1] / "docs"
TEXT = (DOCS / "theory.md").read_text()


def test_the_page_is_current() -> None:
    assert runpy.run_path(str(DOCS / "generate_theory.py"))["page"]() == TEXT, "run `make docs`"


def test_every_effect_has_its_equation_parameters_and_source() -> None:
    sections = dict(re.findall(r"^### `(\w+)`\n(.*?)(?=^##|\Z)", TEXT, re.MULTILINE | re.DOTALL))
    assert list(sections) == list(CATALOGUE)
    for name, section in sections.items():
        effect = CATALOGUE[name]
        assert f"\n    {effect.definition}\n" in section
        assert f"- *Source*: {effect.source}\n" in section
        for parameter in effect.parameters:
            assert re.search(
                rf"^\| `{parameter.name}` \|.*\| {re.escape(parameter.meaning)} \|$", section, re.MULTILINE
            )


def test_tables_have_rows_of_one_width_and_links_lead_somewhere() -> None:
    table: list[str] = []
    for line in [*TEXT.splitlines(), ""]:
        if line.startswith("|"):
            table.append(line)
        elif table:
            assert len({len(re.findall(r"(?<!\\)\|", row)) for row in table}) == 1, table[0]
            table = []
    headings = {
        re.sub(r"[^\w\- ]", "", title).lower().replace(" ", "-")
        for title in re.findall(r"^#+ (.*)$", TEXT, re.MULTILINE)
    }
    assert set(re.findall(r"\]\(#([^)]*)\)", TEXT)) <= headings


def test_sources_stand_among_the_references() -> None:
    references = TEXT.split("## References")[1]
    for effect in CATALOGUE.values():
        for author, year in re.findall(
            r"([A-Z]\w+)(?: et al\.| and \w+|, [A-Z]\w+ and \w+)? \((\d{4})\)", effect.source
        ):
            assert re.search(rf"{author}.*\({year}\)", references), (author, year)
