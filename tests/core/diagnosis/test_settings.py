"""Numbers that steer the diagnosis: each is explained and used, and none is hidden in another module."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from hydro.core.diagnosis import settings

CORE = Path(settings.__file__).parents[1]
PACKAGES = ("diagnosis", "discovery", "explanation")
MODULES = [
    path for name in PACKAGES for path in sorted((CORE / name).glob("*.py")) if path.stem != "settings"
]
ELSEWHERE = {
    "baseline": {"SHOT_LENGTHS"},  # halvings of the usual length
    "pipeline": {"NAMED", "CHECKED"},  # progress bar
    "explain": {"TRIED", "COMPARED"},  # progress bar
    "identifiability": {"EXACT", "STATES", "MIDDLE", "REACH", "SPEED"},  # random states of an exact test
    "terms": {"OWN_POWERS", "OTHER_POWERS", "SIZE_POWERS", "AHEAD_POWERS"},  # grids
    "unexplained": {"WRENCH"},  # six components
}
"""Numbers that are mathematics, layout or display, by module."""
OF_HULL = ("limits", "hull", "library", "regression", "allowance", "joint_posterior")
"""Modules of the hull-force model that have numbers."""
NO_JUDGEMENT = {"FACTORS", "TEMPERS", "SPREADS", "AXES", "RESTING", "LEAST", "ROWS_TOGETHER"}
"""Grids, sizes and the lower bound of a divisor in these modules."""


def numbers(text: str) -> Iterator[tuple[str, bool]]:
    """Yield the name of each numeric constant of a module, and whether a docstring follows it.

    A constant that is computed from others with whole numbers, such as half of one, is no number of its own.
    """
    body = ast.parse(text).body
    for node, follows in zip(body, [*body[1:], None], strict=True):
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        inside = [one.value for one in ast.walk(node.value) if isinstance(one, ast.Constant)]
        numeric = [one for one in inside if isinstance(one, int | float) and not isinstance(one, bool)]
        if not numeric or any(isinstance(one, str) for one in inside):
            continue
        if uses_constants(node.value) and all(one == round(one) for one in numeric):
            continue
        told = isinstance(follows, ast.Expr) and isinstance(follows.value, ast.Constant)
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        for target in targets:
            yield from ((one.id, told) for one in ast.walk(target) if isinstance(one, ast.Name))


def uses_constants(value: ast.expr) -> bool:
    """Return whether an expression uses constants, such as FIT or `limits.FIT`."""
    names = [one.id for one in ast.walk(value) if isinstance(one, ast.Name)]
    names += [one.attr for one in ast.walk(value) if isinstance(one, ast.Attribute)]
    return any(name.isupper() for name in names)


def test_each_setting_has_a_docstring_and_is_used() -> None:
    found = dict(numbers(Path(settings.__file__).read_text()))
    assert [name for name, told in found.items() if not told] == []
    used = {
        alias.name
        for path in MODULES
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ImportFrom) and node.module == settings.__name__
        for alias in node.names
    }
    assert set(found) <= used
    assert {name for name in vars(settings) if name.isupper()} == used


def test_at_most_45_numbers_steer_the_diagnosis_and_the_hull_force_model() -> None:
    paths = [Path(settings.__file__), *(CORE / "residual" / f"{name}.py" for name in OF_HULL)]
    found = [name for path in paths for name, _ in numbers(path.read_text()) if name not in NO_JUDGEMENT]
    assert len(found) <= 45, found


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.stem)
def test_no_module_of_the_diagnosis_has_numbers_outside_the_settings(path: Path) -> None:
    assert {name for name, _ in numbers(path.read_text())} == ELSEWHERE.get(path.stem, set())


def test_a_planted_number_is_detected() -> None:
    assert list(
        numbers('A = 0.5\n"""Share."""\nB: int = 3\nC = "text"\nD, E = 1, 2\nF = True\nG = A / 2')
    ) == [
        ("A", True),
        ("B", False),
        ("D", False),
        ("E", False),
    ]
