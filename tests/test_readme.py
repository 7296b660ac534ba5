"""What README.md and docs/api.md tell a newcomer to type exists and runs.

Checked are commands, options, targets, files and functions.  The longest example runs in `test_docs_api`.
`HYDRO_DEMO` names a folder where `make demo` has run already: its explanation is the README's.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import browser
import forked
import pytest
from tables import shorten

import hydro
from hydro import cli

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "datasets").glob("*.md")])
README = (ROOT / "README.md").read_text()
API = (ROOT / "docs" / "api.md").read_text()
PYTHON = README + API
"""Pages whose Python examples run one after the other."""
SCREENS = 6
"""Length of the report on a phone, in screens."""


def code(text: str) -> str:
    """The indented blocks and fences of a page."""
    fenced = re.findall(r"```(?:\w*)\n(.*?)```", text, re.DOTALL)
    return "\n".join([*fenced, *re.findall(r"^    (.*)$", text, re.MULTILINE)])


def command_lines() -> list[list[str]]:
    """Every `hydro COMMAND ...` of all pages, pipes taken apart."""
    lines = []
    for page in PAGES:
        for line in code(page.read_text()).replace("\\\n", " ").splitlines():
            for part in line.split("#")[0].split("|"):
                if part.strip().startswith("hydro "):
                    lines.append(shlex.split(part))
    return lines


def test_commands_and_options_exist(capsys: pytest.CaptureFixture[str]) -> None:
    lines = command_lines()
    assert len(lines) > 5
    families = {family.NAME for family in cli.FAMILIES}
    for _, command, *rest in lines:
        named = [command, rest.pop(0)] if command in families else [command]
        assert cli.main([*named, "--help"]) == 0, command
        text = capsys.readouterr().out
        for option in (word for word in rest if word.startswith("-") and word != "-"):
            assert re.search(rf"(?<![\w-]){option}\b", text), f"hydro {command} has no {option}"


def test_targets_exist() -> None:
    targets = set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for page in PAGES:
        assert set(re.findall(r"\bmake (\w+)", code(page.read_text()))) <= targets, page.name


def test_links_lead_somewhere() -> None:
    links = [(page, target) for page in PAGES for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text())]
    assert len(links) > 100
    assert [(page.name, target) for page, target in links if not (page.parent / target).exists()] == []


def test_functions_exist() -> None:
    named = set(re.findall(r"\bhydro\.(\w+)\(", PYTHON))
    assert named >= {"read", "diagnose", "add", "compare", "labels", "split", "train", "replay"}
    assert named <= set(hydro.__all__)


def shorter(snippets: str) -> str:
    """The same with the options that the README names for a first try; what installs is only planned."""
    changes = (
        (r"^make ", "make -n "),
        (r"--epochs 20", "--epochs 1"),
        (r"epochs=20", "epochs=1"),
        (r"^(hydro rl train .*?)(?= *#|$)", r"\1 --steps 400"),
        (r"^(hydro rl eval .*?)(?= *#|$)", r"\1 --episodes 4"),
    )
    for pattern, change in changes:
        snippets, count = re.subn(pattern, change, snippets, flags=re.MULTILINE)
        assert count, f"the README has no {pattern} any more"
    return snippets


def explained(shell: str, demo: Path) -> str:
    """Return the shell with the study of the demonstration, instead of the command that made the same study.

    Args:
        shell: Lines of the README.
        demo: Folder where `make demo` has run, with what it printed in `demo.log` beside it.
    """
    command, end = re.findall(r"^(hydro explain (?:.*\\\n)*.*?) -o runs/study(.*\n)", shell, re.MULTILINE)[0]
    ran = demo.with_name("demo.log").read_text()
    words = " ".join(command.replace("\\\n", " ").split())
    assert f"$ {words} -o {demo.name}/study\n" in ran, "the demonstration runs this command"
    taken = f"mkdir runs && cp -r {shlex.quote(str(demo / 'study'))} runs/study"
    return shell.replace(f"{command} -o runs/study{end}", f"{taken}\n")


def snippets() -> tuple[str, str]:
    """Return all shell of the README, and the Python of both pages that no other test runs."""
    other = API.split("\n## Results\n")[1]
    outside = re.sub(r"```.*?```", "", README, flags=re.DOTALL)
    shell = "".join(f"{line}\n" for line in re.findall(r"^ {4}(\s*\S.*)$", outside, re.MULTILINE))
    python = "\n".join(re.findall(r"```python\n(.*?)```", README + other, re.DOTALL))
    return shell, python


@pytest.mark.slow
def test_all_of_it_runs_pasted_into_a_fresh_checkout(tmp_path: Path) -> None:
    checkout = tmp_path / "checkout"
    binaries = checkout / ".venv" / "bin"
    binaries.mkdir(parents=True)
    shutil.copytree(ROOT / "datasets", checkout / "datasets")
    shorten(checkout / "datasets" / "hidden", 10.0, sessions=2)
    shorten(checkout / "datasets" / "changed", 8.5, sessions=9)
    shorten(checkout / "datasets" / "changed", 8.5, sessions=3, names="thruster*")
    shorten(checkout / "datasets" / "stonefish", 15.0, sessions=10)
    shutil.copy(ROOT / "Makefile", checkout)
    shutil.copy(ROOT / "pyproject.toml", checkout)
    (binaries / "activate").write_text(f'export PATH="{binaries}:$PATH"\n')
    shell, python = snippets()
    both = shorter(f"{shell}\0{python}")
    shell, python = both.split("\0")
    if there := os.environ.get("HYDRO_DEMO"):
        shell = explained(shell, Path(there).resolve())
    environment = os.environ | {"PYTHONPATH": str(ROOT), "MUJOCO_GL": "egl", "COLUMNS": "170"}
    printed = []
    (binaries / "hydro").symlink_to(forked.program())
    for line, pasted in ((["bash", "-euo", "pipefail"], shell), ([forked.python(), "-"], python)):
        done = subprocess.run(
            line, input=pasted.encode(), cwd=checkout, env=environment, capture_output=True, timeout=1200
        )
        assert done.returncode == 0, done.stderr.decode()[-3000:]
        printed.append((done.stdout + done.stderr).decode(errors="replace"))
    assert {"study", "report.html", "model.parquet", "replay.parquet", "rov.sdf", "policy"} <= {
        path.name for path in (checkout / "runs").iterdir()
    }
    if browser.CHROMIUM is not None:
        with browser.page() as page:
            page.screen(390, 844, touch=True)
            page.open(checkout / "runs" / "report.html")
            assert page.run("document.documentElement.scrollHeight") <= SCREENS * 844
    assert "noise_floor" in printed[1], "the example of the README prints errors"
    assert "MJ4" in printed[1], "the example of docs/api.md replays its network"


def test_the_first_command_comes_within_a_screen() -> None:
    lines = README.splitlines()
    first = next(number for number, line in enumerate(lines, 1) if line.startswith("    hydro "))
    assert first <= 50
