"""The mutation test: its changes, the kernels that they reach, and what it finds in a tiny package."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.mutants import __main__ as command
from benchmarks.mutants import sites
from benchmarks.mutants.names import Names
from benchmarks.mutants.nearest import Tests
from benchmarks.mutants.tree import Tree

ROOT = Path(__file__).resolve().parents[1]
SOURCE = '''"""Doubles 2 + 3."""

__all__ = ["double" + "s"]


def double(x: int | None, *rest, least=1e-9) -> "int | float":
    """Twice 1 + 1."""
    assert x is not None
    for one, two in zip(rest, rest, strict=True):
        x += one - two
    if not rest and x >= 10:
        raise ValueError(f"{x + 1} is more than {3 * 3}")
    return max(
        x * 2,
        -x + (least
              - 0.5),
    )
'''


def test_operators_constants_and_terms_change_and_words_for_people_do_not():
    found = {(site.line, SOURCE[site.start : site.stop], site.new) for site in sites.sites(SOURCE)}
    assert found == {
        (6, "1e-9", "1.0"),
        (10, "+=", "-="),
        (10, "-", "+"),
        (10, "- two", ""),
        (11, "not ", ""),
        (11, "and", "or"),
        (11, ">=", ">"),
        (11, ">=", "<"),
        (11, "10", "11"),
        (13, "max", "min"),
        (14, "*", "/"),
        (14, "2", "3"),
        (15, "-", ""),
        (15, "+", "-"),
        (15, "+ (least\n              - 0.5)", "\n"),
        (16, "-", "+"),
        (16, "0.5", "1.0"),
    }


@pytest.mark.parametrize("module", ["core/vehicle/control_allocation", "io/toml", "rl/environment/reward"])
def test_a_change_moves_no_line_and_parses(module):
    source = (ROOT / "hydro" / f"{module}.py").read_text()
    found = sites.sites(source)
    assert len(found) > 15
    for site in found[::9]:
        assert sites.valid(source, site), site
        assert sites.changed(source, site).count("\n") == source.count("\n")


def test_a_kernel_reaches_its_callers_and_a_record_none():
    """Functions that are compiled from generated source call every kernel of the catalogue."""
    names = Names(
        ROOT, [*(ROOT / "hydro/core/effects").glob("*.py"), *(ROOT / "hydro/core/simulation").glob("*.py")]
    )

    def reached(module, name):
        return {each for _, each in names.compiled(names.affected([(f"hydro.core.effects.{module}", name)]))}

    assert {"linear", "wrench", "accelerate"} <= reached("damping", "linear")
    assert {"power", "wrench"} <= reached("damping", "power")
    assert "linear" not in reached("damping", "power")
    assert reached("damping", "EFFECTS") == set()
    assert "linear" in reached("layout", "RELATIVE_VELOCITY")


PACKAGE = {
    "tiny/__init__.py": "",
    "tiny/sums.py": "def total(a, b):\n    return a + b\n",
    "tiny/ratios.py": "def ratio(a, b):\n    return a / b\n",
    "tiny/limits.py": "def raised(x, by, done):\n    while not done(x):\n        x += by\n    return x\n",
    "tiny/unseen.py": "GAIN = 3\n",
    "tests/test_sums.py": "from tiny.sums import total\n\n\n"
    "def test_nothing():\n    assert total(0, 0) == 0\n",
    "tests/test_ratios.py": "from tiny.ratios import ratio\n\n\n"
    "def test_half():\n    assert ratio(2, 4) == 0.5\n",
    "tests/test_limits.py": "from tiny.limits import raised\n\n\n"
    "def test_it_ends():\n    assert raised(0, 1, lambda x: x > 3) == 4\n",
}
"""In `sums` no change is noticed, in `ratios` every one; in `limits` one loops for ever."""
FAILING = "from tiny.sums import total\n\n\ndef test_broken():\n    assert total(1, 1) == 5\n"
SHARP = "from tiny.sums import total\n\n\ndef test_something():\n    assert total(1, 1) == 2\n"


@pytest.fixture
def checkout(tmp_path) -> Path:
    for name, text in PACKAGE.items():
        path = tmp_path / "checkout" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path / "checkout"


def test_the_nearest_tests_bear_the_modules_name_then_mention_what_changes(checkout):
    (checkout / "tests" / "helper.py").write_text("from tiny import limits\n")
    (checkout / "tests" / "test_a.py").write_text("import helper\n")
    (checkout / "tests" / "test_b.py").write_text(
        "from tiny import limits\n\nlimits.other\n" + "# long\n" * 9
    )
    (checkout / "tests" / "test_c.py").write_text("from tiny import limits\n\nlimits.raised\n")
    names = Names(checkout, (checkout / "tiny").glob("*.py"))
    nearest = Tests(checkout, names).nearest([("tiny.limits", "raised")])
    assert [path.name for path in nearest] == ["test_limits.py", "test_c.py", "test_b.py", "test_a.py"]


def test_a_tiny_package(checkout):
    """A change that a test notices, one that none does, one that never ends, and one without a test."""
    table = checkout.parent / "rows.csv"

    def run(*options):
        words = ["--checkout", checkout, "--package", "tiny", "--where", "tiny/*", "-o", table]
        words += ["--work", checkout.parent / "work"]
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.mutants", *map(str, words), "--per-test", "1", *options],
            **{"cwd": ROOT, "text": True, "capture_output": True, "check": False},
        )
        assert done.returncode == 0, done.stderr
        return {(row["code"], row["new"]): row["status"] for row in command.read(table)}, done.stdout

    first, said = run("--count", "20", "--seed", "3")
    statuses = {code: status for (code, _), status in first.items()}
    assert statuses == {
        "return a + b": "alive",
        "return a / b": "killed",
        "while not done(x):": "killed",
        "x += by": "timeout",
        "GAIN = 3": "untested",
    }
    assert "part all  mutants 5  killed 3  equivalent 0  alive 2" in said
    assert {str(path.relative_to(checkout)): path.read_text() for path in checkout.rglob("*.py")} == PACKAGE

    (checkout / "tests" / "test_broken.py").write_text(FAILING)
    second, said = run("--again", "alive")
    assert second == first, "a test that fails without the change too is no proof"
    assert said.count("/1 ") == 1, "nothing else is tested twice"
    (checkout / "tests" / "test_more.py").write_text(SHARP)
    third, _ = run("--again", "alive")
    assert {code: status for (code, _), status in third.items()} == statuses | {"return a + b": "killed"}


def test_lines_that_move_keep_their_mutants_and_lines_that_change_lose_them(checkout):
    tree = Tree(checkout, checkout.parent / "work", "tiny")
    (row,) = command.drawn(tree, 1, 0, ["tiny/ratios.py"])
    (tree.root / "tiny/ratios.py").write_text("# one\n# two\n" + PACKAGE["tiny/ratios.py"])
    change = command.located(tree, row)
    assert change is not None
    assert change.site.line == int(row["line"]) + 2
    (tree.root / "tiny/ratios.py").write_text("def ratio(a, b):\n    return a / (b)\n")
    assert command.located(tree, row) is None
