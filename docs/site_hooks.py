"""Pages of the site from outside docs/: README, "Add an effect" of CONTRIBUTING, and the list of decisions.

Links to files outside docs/ work on GitHub; on the site they become plain text.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[1]
LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(([^)\s]+)\)")


def on_files(files: Files, config: Any) -> Files:
    """Add the pages from outside docs/."""
    pages = {"index.md": home(), "own-effect.md": own_effect(), "decisions.md": decisions()}
    for name, text in pages.items():
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, files: Files, **_: Any) -> str:
    """Replace links that lead out of docs/ by their text."""

    def kept(link: re.Match[str]) -> str:
        target = link[2].partition("#")[0]
        if not target or ":" in target:
            return link[0]
        path = posixpath.normpath(posixpath.join(posixpath.dirname(page.file.src_uri), target))
        return link[0] if files.get_file_from_path(path) else link[1]

    return LINK.sub(kept, markdown)


def home() -> str:
    """Return the README with links relative to docs/."""
    text = re.sub(r"\]\(docs/", "](", (ROOT / "README.md").read_text())
    return text.replace("](adr)", "](decisions.md)").replace("](CONTRIBUTING.md)", "](own-effect.md)")


def own_effect() -> str:
    """Return a section of CONTRIBUTING as a page, with list content indented by four spaces."""
    section = (ROOT / "CONTRIBUTING.md").read_text().split("## Add an effect\n")[1].split("\n## ")[0]
    return "# Your own effect\n" + re.sub(r"^ {3}(?=\s*\S)", " " * 4, section, flags=re.MULTILINE)


def decisions() -> str:
    """Return a list of all decisions by title."""
    titles = {
        path.name: path.read_text().splitlines()[0].lstrip("# ") for path in (ROOT / "docs/adr").glob("*.md")
    }
    lines = [f"- [{title}](adr/{name})" for name, title in sorted(titles.items())]
    return (
        "# Decisions\n\nDecisions that still hold: context, decision and consequences.\n\n"
        + "\n".join(lines)
        + "\n"
    )
