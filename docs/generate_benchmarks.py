"""Write the pages with result tables, docs/PAGES.md, from their templates, for `make docs`.

A result table is benchmarks/results/NAME.csv: the measured values first, then their origin. A line
`{{table:NAME}}` of docs/templates/*.md.in is replaced by the table and a line with its origin. Text between
the lines `{{with:NAME}}` and `{{end}}` is omitted if that table does not exist.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable
from pathlib import Path

DOCS = Path(__file__).parent
PAGES = (
    "apart", "benchmarks", "challenge", "divergence", "engines", "export", "fins", "future-work", "gpu",
    "imperfect", "import-figures", "mpc", "paper", "paper-recipe", "proof", "public-recordings", "rl-figures",
    "robustness", "scoreboard", "stonefish", "track", "workbench-figures",
)  # fmt: skip
RESULTS = Path(__file__).resolve().parents[1] / "benchmarks" / "results"

ORIGIN = ("commit", "recorded", "date", "command", "seeds")
"""Columns of the origin: measured code, commit that recorded the figure, day, command line, seeds."""


def page(name: str) -> str:
    """Return a complete page."""
    template = measured((DOCS / "templates" / f"{name}.md.in").read_text())
    return re.sub(r"^\{\{table:(\w+)\}\}$", lambda found: table(found[1]), template, flags=re.MULTILINE)


def measured(template: str) -> str:
    """Return the template without sections whose table does not exist."""

    def part(found: re.Match[str]) -> str:
        return found[2] if (RESULTS / f"{found[1]}.csv").exists() else ""

    pattern = r"^\{\{with:(\w+)\}\}\n(.*?)^\{\{end\}\}\n"
    return re.sub(pattern, part, template, flags=re.MULTILINE | re.DOTALL)


def results(name: str) -> list[dict[str, str]]:
    """Return the rows of a result table, with cells as text."""
    with (RESULTS / f"{name}.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def table(name: str) -> str:
    """Return a result table in Markdown, after a line with its origin."""
    rows = results(name)
    columns = [column for column in rows[0] if column not in ORIGIN]
    lines = [columns, ["---"] * len(columns), *([row[column] for column in columns] for row in rows)]
    return "\n".join([_origin(name, rows), "", *(f"| {' | '.join(map(_cell, line))} |" for line in lines)])


def _cell(text: str) -> str:
    """Return the text of a cell, with non-breaking intervals."""
    return re.sub(r" to (?=[\d.-]+[)\]])", "\u00a0to\u00a0", text.strip())


def _origin(name: str, rows: list[dict[str, str]]) -> str:
    """Return the line with the origin of a table: file, commands, seeds, days and commits."""
    said = {key: _unique(row[key] for row in rows) for key in ORIGIN}
    recorded = ", ".join(sorted(said["date"])) + (
        f" in {', '.join(said['recorded'])}" if said["recorded"] else ""
    )
    parts = [f"[{name}.csv](../benchmarks/results/{name}.csv)", f"recorded {recorded}"]
    parts += [f"code of {', '.join(said['commit'])}"] if said["commit"] else []
    parts += [f"seeds {said['seeds'][0]}"] if len(said["seeds"]) == 1 else []
    parts += (
        [f"`{said['command'][0]}`"] if len(said["command"]) == 1 else ["command lines and seeds in the file"]
    )
    return "<br>" + ": ".join([parts[0], "; ".join(parts[1:])])


def _unique(values: Iterable[str]) -> list[str]:
    """Return distinct values in order, without empty, unrecorded and unused ones."""
    return [value for value in dict.fromkeys(values) if value not in ("", "not recorded", "not used")]


if __name__ == "__main__":
    for each in PAGES:
        (DOCS / f"{each}.md").write_text(page(each))
