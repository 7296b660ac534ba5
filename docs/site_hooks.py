"""What the site shows besides docs/: README as its home, "Add an effect" of CONTRIBUTING, the decisions.

On GitHub the same pages link to files beside docs/; those links become the bare file names here.
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
    """Add the pages that are written elsewhere."""
    pages = {"index.md": home(), "own-effect.md": own_effect(), "decisions.md": decisions()}
    for name, text in pages.items():
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, files: Files, **_: Any) -> str:
    """Leave the words of links that lead out of docs/."""

    def kept(link: re.Match[str]) -> str:
        target = link[2].partition("#")[0]
        if not target or ":" in target:
            return link[0]
        path = posixpath.normpath(posixpath.join(posixpath.dirname(page.file.src_uri), target))
        return link[0] if files.get_file_from_path(path) else link[1]

    return LINK.sub(kept, markdown)


def home() -> str:
    """README, its links as they are from docs/."""
    text = re.sub(r"\]\(docs/", "](", (ROOT / "README.md").read_text())
    return text.replace("](adr)", "](decisions.md)").replace("](CONTRIBUTING.md)", "](own-effect.md)")


def own_effect() -> str:
    """The section of CONTRIBUTING, as a page; blocks within its list indented as this Markdown asks for."""
    section = (ROOT / "CONTRIBUTING.md").read_text().split("## Add an effect\n")[1].split("\n## ")[0]
    return "# Your own effect\n" + re.sub(r"^ {3}(?=\s*\S)", " " * 4, section, flags=re.MULTILINE)


def decisions() -> str:
    """A list of all decisions by their titles."""
    titles = {
        path.name: path.read_text().splitlines()[0].lstrip("# ") for path in (ROOT / "docs/adr").glob("*.md")
    }
    lines = [f"- [{title}](adr/{name})" for name, title in sorted(titles.items())]
    return (
        "# Decisions\n\nDecisions that still hold: context, decision and consequences.\n\n"
        + "\n".join(lines)
        + "\n"
    )
