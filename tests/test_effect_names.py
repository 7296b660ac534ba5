"""No effect is called by its name outside the catalogue: what is known of it stands in its record."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from hydro.core.effects import CATALOGUE, examples

PACKAGE = Path(__file__).resolve().parents[1] / "hydro"
HOME = PACKAGE / "core" / "effects"
MODULES = sorted(path for path in PACKAGE.rglob("*.py") if HOME not in path.parents)
NAME = re.compile(rf"\b(?:{'|'.join(CATALOGUE)})\b")
DOCUMENTED = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef | ast.Assign | ast.AnnAssign


def named(tree: ast.AST) -> list[str]:
    """Effects named in the strings under `tree`, docstrings excepted."""
    nodes = list(ast.walk(tree))
    documentation = {text for node in nodes for text in documented(node)}
    return [
        f"{name} (line {node.lineno})"
        for node in nodes
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in documentation
        for name in NAME.findall(node.value)
    ]


def documented(node: ast.AST) -> Iterator[ast.expr]:
    """Strings that stand first in a definition, or right after a constant."""
    body = getattr(node, "body", None)
    if not isinstance(body, list):
        return
    for before, here in zip([node, *body], body, strict=False):
        if isinstance(before, DOCUMENTED) and isinstance(here, ast.Expr):
            yield here.value


def test_effects_are_named_in_their_records_alone() -> None:
    found = {str(path.relative_to(PACKAGE)): named(ast.parse(path.read_text())) for path in MODULES}
    assert {module: names for module, names in found.items() if names} == {}


@pytest.mark.parametrize(
    "line",
    [
        "BESIDE = ('tether',)",
        "def f(x):\n    return f'fit {x} or linear_damping'",
        "h = 'as ocean_current={v_N=0.3}'",
        "x = {'payload': 1}",
        "def f():\n    g('payload')\n    'tether'",
    ],
)
def test_a_name_in_any_string_is_found(line: str) -> None:
    assert len(named(ast.parse(line))) in (1, 2)


def test_what_documents_is_left_alone_and_so_are_words_that_are_no_names() -> None:
    assert not named(ast.parse('"""Of a tether."""\nA = 1\n"""Less than a payload."""'))
    assert not named(ast.parse("x = 'added mass', 'payloads', added_mass"))
    assert len(MODULES) > 100


def test_the_examples_of_the_command_line_are_admissible() -> None:
    assert {examples.TO_LOOK_UP, examples.TO_FIT} <= set(CATALOGUE)
    for text in (examples.TO_HIDE, examples.TO_FIT_FROM):
        for name, table in tomllib.loads(text).items():
            CATALOGUE[name].pack(table, thrusters=1)
