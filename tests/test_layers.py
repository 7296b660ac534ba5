"""Imports point one way: cli -> commands -> {rl -> sim, learn, report} -> io -> core."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "hydro"
ABOVE_IO = {"sim", "learn", "report"}
MAY_IMPORT = {
    "cli": {"commands", "core"},
    "commands": {"commands", "rl", *ABOVE_IO, "io", "core"},
    "rl": {"rl", "sim", "io", "core"},
    "sim": {"sim", "io", "core"},
    "learn": {"learn", "io", "core"},
    "report": {"report", "io", "core"},
    "io": {"io", "core"},
    "core": {"core", "_moved"},
    "api": {"rl", *ABOVE_IO, "io", "core"},
    "__init__": {"api", "_moved"},
    "__main__": {"cli"},
    "_moved": set(),
}
ONLY_IN = {
    "torch": {"learn", "rl", "io/model.py"},
    "torchrl": {"rl"},
    "tensordict": {"rl"},
    "mujoco": {"sim"},
    "typer": {"cli.py", "commands"},
    "rich": {"cli.py", "commands", "report"},
    "matplotlib": {"report"},
    "plotly": {"report"},
}
HEAVY = {
    "polars",
    "pyarrow",
    "numpy",
    "numba",
    "scipy",
    "torch",
    "mujoco",
    "matplotlib",
    "plotly",
    "filterpy",
    "rich",
}
MODULES = sorted(PACKAGE.rglob("*.py"))


def layer(path: Path) -> str:
    """The layer a module belongs to: its folder under hydro, or its own name at the top."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported(tree: ast.AST) -> list[str]:
    """Absolute names of everything imported under `tree`, in functions and for type checkers too."""
    names = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports hide the layer they reach into"
            names += [f"{node.module}.{alias.name}" for alias in node.names]
    return names


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_point_one_way(path: Path) -> None:
    names = imported(ast.parse(path.read_text()))
    reached = {name.split(".")[1] for name in names if name.startswith("hydro.")}
    assert reached <= MAY_IMPORT[layer(path)], (
        f"{layer(path)} must not import {reached - MAY_IMPORT[layer(path)]}"
    )


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_libraries_stay_where_they_belong(path: Path) -> None:
    where = {layer(path), path.relative_to(PACKAGE).as_posix()}
    for name in imported(ast.parse(path.read_text())):
        library = name.split(".")[0]
        assert library not in ONLY_IN or where & ONLY_IN[library], f"{library} belongs to {ONLY_IN[library]}"


@pytest.mark.parametrize("name", ["__init__.py", "__main__.py", "_moved.py", "api.py", "cli.py", "commands"])
def test_nothing_heavy_at_import(name: str) -> None:
    found = PACKAGE / name
    for path in [found] if found.is_file() else sorted(found.rglob("*.py")):
        top = [
            node for node in ast.parse(path.read_text()).body if isinstance(node, ast.Import | ast.ImportFrom)
        ]
        heavy = {name.split(".")[0] for name in imported(ast.Module(top, []))} & HEAVY
        assert not heavy, f"{path.name} imports {heavy} at start-up"


def test_the_rule_is_not_vacuous() -> None:
    assert {layer(path) for path in MODULES} >= {"cli", "commands", "core", "io", "learn", "sim", "report"}
    sample = ast.parse("import torch\nfrom hydro.sim import student\ndef f():\n    import mujoco.batch")
    assert imported(sample) == ["torch", "hydro.sim.student", "mujoco.batch"]
