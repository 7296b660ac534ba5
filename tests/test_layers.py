"""Imports point one way: between layers, between the packages of each, and never in a circle."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "hydro"
ABOVE_IO = {"sim", "learn", "report"}
MAY_IMPORT = {
    "cli": {"commands", "core"},
    "app": {"app", "study", "report", "io", "core"},
    "commands": {"commands", "app", "study", "export", "rl", *ABOVE_IO, "io", "core"},
    "export": {"export", "rl", "sim", "learn", "io", "core"},
    "study": {"study", "rl", *ABOVE_IO, "io", "core"},
    "rl": {"rl", "sim", "io", "core"},
    "sim": {"sim", "io", "core"},
    "learn": {"learn", "io", "core"},
    "report": {"report", "io", "core"},
    "io": {"io", "core"},
    "core": {"core", "_moved"},
    "api": {"api", "rl", *ABOVE_IO, "io", "core"},
    "__init__": {"api", "_moved"},
    "__main__": {"cli"},
    "_moved": set(),
}
LEVELS = {
    "hydro.core": (
        ("discovery", "explanation", "history"),
        ("diagnosis",),
        ("difference",),
        ("experiment",),
        ("sea",),
        ("evaluation", "audit"),
        ("preprocessing",),
        ("residual",),
        ("identification",),
        ("prediction",),
        ("distillation",),
        ("simulation",),
        ("cleaning", "guessing"),
        ("logs",),
        ("recording", "geometry"),
        ("effects",),
        ("vehicle",),
        ("thrust_curves",),
        ("leaky_sum", "local_polynomials"),
        ("columns",),
        ("toml_text", "seeds"),
        ("threads",),
        ("compiled",),
        ("embedded_code",),
        ("extras", "kernel_cache"),
        ("compiler_flags", "kernel_turns", "separate_code"),
        ("errors", "interval", "nesting", "progress"),
    ),
    "hydro.sim": (
        ("film", "gpu", "kernel_plant", "replay", "stonefish", "teacher_plant"),
        ("fleet_plant",),
        ("flight",),
        ("plant", "scene", "single", "teacher"),
        ("craft", "student"),
        ("bridge",),
        ("residual",),
    ),
    "hydro.rl": (("gpu",), ("training",), ("environment",), ("tasks",), ("world",)),
}
"""Packages and modules of a layer, topmost first: each may import what stands below its own line."""
ONLY_IN = {
    "torch": {"learn", "rl", "io/model.py", "export/onnx_network.py"},
    "torchrl": {"rl"},
    "tensordict": {"rl"},
    "mujoco": {"sim"},
    "casadi": {"export"},
    "ray": {"study/cluster.py"},
    "typer": {"cli.py", "commands"},
    "rich": {"cli.py", "commands", "report"},
    "matplotlib": {"report"},
    "plotly": {"report"},
    "nicegui": {"app", "commands/app.py"},
    "fastapi": {"app"},
    "uvicorn": {"app"},
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
    "ray",
    "rich",
}
MODULES = sorted(PACKAGE.rglob("*.py"))
Graph = dict[str, set[str]]


def layer(path: Path) -> str:
    """The layer a module belongs to: its folder under hydro, or its own name at the top."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def parsed(path: Path) -> ast.Module:
    """Syntax tree of a file."""
    return tree_of(path.read_text())


@cache
def tree_of(text: str) -> ast.Module:
    """Syntax tree of a source."""
    return ast.parse(text)


@cache
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


def graph(root: Path, *packages: str) -> Graph:
    """Which of the modules under some packages of a folder import which others of them."""
    files = {_name(root, path): path for package in packages for path in (root / package).rglob("*.py")}
    found = {}
    for name, path in files.items():
        names = [*imported(parsed(path))]
        if not (path.parent / "__init__.py").exists():  # scripts know those beside them by their bare names
            names += [f"{name.rpartition('.')[0]}.{each}" for each in names]
        reached = {_module(each, files) for each in names}
        found[name] = {other for other in reached if other not in (None, name)}
    return found


def _name(root: Path, path: Path) -> str:
    """A module's name, a package's that of its folder."""
    return ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__")


def _module(name: str, known: Mapping[str, object]) -> str | None:
    """The module that an imported name is or stands in."""
    while name and name not in known:
        name = name.rpartition(".")[0]
    return name or None


def upward(modules: Graph, top: str, levels: tuple[tuple[str, ...], ...]) -> list[str]:
    """Imports within `top` that do not point to a lower level, and what has no level at all."""
    height = {part: -row for row, parts in enumerate(levels) for part in parts}
    found = []
    for name, reached in modules.items():
        for other in (each for each in reached if _part(each, top) not in ("", _part(name, top))):
            here, there = _part(name, top), _part(other, top)
            if here and not (here in height and there in height and height[here] > height[there]):
                found.append(f"{name} -> {other}")
    return sorted(found)


def _part(name: str, top: str) -> str:
    """The package or module directly under `top` that a module is or stands in; nothing elsewhere."""
    return name.removeprefix(f"{top}.").split(".")[0] if name.startswith(f"{top}.") else ""


def circle(modules: Graph, of: Callable[[str], str] = str) -> list[str]:
    """A circle of imports between modules, or between what `of` makes of them; empty without one."""
    arrows: Graph = {}
    for name, reached in modules.items():
        arrows.setdefault(of(name), set()).update(of(each) for each in reached)
    try:
        TopologicalSorter({name: reached - {name} for name, reached in arrows.items()}).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def package(name: str) -> str:
    """The package that a module stands in; the module itself at the top, as `hydro.cli`."""
    folder = name if (ROOT / Path(*name.split("."))).is_dir() else name.rpartition(".")[0]
    return folder if "." in folder else name


@pytest.fixture(scope="module")
def modules() -> Graph:
    return graph(ROOT, "hydro", "benchmarks")


def against_the_layers(path: Path, tree: ast.AST) -> list[str]:
    """Return the imports of a module that its layer may not make."""
    reached = {name.split(".")[1] for name in imported(tree) if name.startswith("hydro.")}
    return [
        f"{path.name}: {layer(path)} must not import {other}" for other in reached - MAY_IMPORT[layer(path)]
    ]


def misplaced_libraries(path: Path, tree: ast.AST) -> list[str]:
    """Return the libraries that a module imports although they belong elsewhere."""
    where = {layer(path), path.relative_to(PACKAGE).as_posix()}
    libraries = {name.split(".")[0] for name in imported(tree)} & set(ONLY_IN)
    return [
        f"{path.name}: {name} belongs to {ONLY_IN[name]}" for name in libraries if not where & ONLY_IN[name]
    ]


def heavy_at_import(path: Path, tree: ast.Module) -> list[str]:
    """Return the heavy libraries that a module imports as soon as it is imported itself."""
    top = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
    heavy = {name.split(".")[0] for name in imported(ast.Module(top, []))} & HEAVY
    return [f"{path.name} imports {name} at start-up" for name in heavy]


@pytest.fixture(scope="module")
def trees() -> dict[Path, ast.Module]:
    """Syntax trees of all modules of the package."""
    return {path: parsed(path) for path in MODULES}


def test_imports_point_one_way(trees: dict[Path, ast.Module]) -> None:
    assert [fault for path, tree in trees.items() for fault in against_the_layers(path, tree)] == []


def test_a_planted_import_between_layers_is_seen() -> None:
    tree = ast.parse("def f():\n    from hydro.io import table\nfrom hydro.core import errors")
    assert against_the_layers(PACKAGE / "core" / "x.py", tree) == ["x.py: core must not import io"]
    assert against_the_layers(PACKAGE / "sim" / "x.py", tree) == []


@pytest.mark.parametrize("top", LEVELS)
def test_imports_within_a_layer_point_down(top: str, modules: Graph) -> None:
    assert upward(modules, top, LEVELS[top]) == []


@pytest.mark.parametrize("top", LEVELS)
def test_every_part_of_a_layer_has_its_level_and_is_there(top: str, modules: Graph) -> None:
    there = {_part(name, top) for name in modules} - {""}
    assert there == {part for parts in LEVELS[top] for part in parts}


def test_no_modules_and_no_packages_import_one_another_in_a_circle(modules: Graph) -> None:
    assert circle(modules) == []
    assert circle({name: each for name, each in modules.items() if name.startswith("hydro")}, package) == []


def test_hydro_knows_no_benchmark(modules: Graph) -> None:
    arrows = [(name, other) for name, reached in modules.items() for other in reached]
    assert [arrow for arrow in arrows if arrow[0].startswith("hydro") and "benchmarks" in arrow[1]] == []
    assert any(name.startswith("benchmarks") and other.startswith("hydro") for name, other in arrows)


def test_no_test_imports_another() -> None:
    tests = {path.stem for path in (ROOT / "tests").rglob("test_*.py")}
    assert Path(__file__).stem in tests
    for path in (ROOT / "tests").rglob("*.py"):
        names = imported(parsed(path))
        assert not [name for name in names if tests & set(name.split("."))], path


def test_libraries_stay_where_they_belong(trees: dict[Path, ast.Module]) -> None:
    assert [fault for path, tree in trees.items() for fault in misplaced_libraries(path, tree)] == []


def test_a_planted_library_is_seen() -> None:
    tree = ast.parse("def f():\n    import torch.nn\nimport rich")
    assert len(misplaced_libraries(PACKAGE / "core" / "x.py", tree)) == 2
    assert len(misplaced_libraries(PACKAGE / "learn" / "x.py", tree)) == 1
    assert misplaced_libraries(PACKAGE / "io" / "model.py", ast.parse("import torch")) == []


def test_nothing_heavy_at_import(trees: dict[Path, ast.Module]) -> None:
    light = {"__init__", "__main__", "_moved", "api", "cli", "commands"}
    light_trees = {path: tree for path, tree in trees.items() if layer(path) in light}
    assert {layer(path) for path in light_trees} == light
    assert [fault for path, tree in light_trees.items() for fault in heavy_at_import(path, tree)] == []


def test_a_planted_heavy_import_is_seen() -> None:
    tree = ast.parse("import numpy as np\ndef f():\n    import torch")
    assert heavy_at_import(PACKAGE / "cli.py", tree) == ["cli.py imports numpy at start-up"]


def test_the_rule_is_not_vacuous() -> None:
    assert {layer(path) for path in MODULES} >= {"cli", "commands", "core", "io", "learn", "sim", "report"}
    sample = ast.parse("import torch\nfrom hydro.sim import student\ndef f():\n    import mujoco.batch")
    assert imported(sample) == ["torch", "hydro.sim.student", "mujoco.batch"]


@pytest.fixture
def planted(tmp_path: Path) -> Callable[[str, str], Graph]:
    """A tree of two packages, the upper importing the lower; `plant` adds a line to a file."""
    for name, text in {
        "app/__init__.py": "",
        "app/upper/__init__.py": "",
        "app/upper/a.py": "from app.upper import b\nfrom app.lower.c import thing\n",
        "app/upper/b.py": "",
        "app/lower/__init__.py": "",
        "app/lower/c.py": "from app.lower import d\nthing = d\n",
        "app/lower/d.py": "",
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)

    def plant(name: str, line: str) -> Graph:
        file = tmp_path / name
        file.write_text(file.read_text() + line)
        return graph(tmp_path, "app")

    return plant


ORDER = (("upper",), ("lower",))


def test_a_clean_tree_passes(planted: Callable[[str, str], Graph]) -> None:
    clean = planted("app/lower/d.py", "")
    assert clean["app.upper.a"] == {"app.upper.b", "app.lower.c", "app.upper"} - {"app.upper"}
    assert upward(clean, "app", ORDER) == []
    assert circle(clean) == []
    assert circle(clean, lambda name: name.rpartition(".")[0]) == []


def test_a_planted_upward_import_is_seen_even_within_a_function(
    planted: Callable[[str, str], Graph],
) -> None:
    bent = planted("app/lower/d.py", "def f():\n    from app.upper.b import x\n")
    assert upward(bent, "app", ORDER) == ["app.lower.d -> app.upper.b"]
    assert upward(bent, "app", (("upper", "lower"),)) != [], "nothing points sideways"
    assert circle(bent) == []
    assert set(circle(bent, lambda name: name.rpartition(".")[0])) == {"app.upper", "app.lower"}


def test_a_planted_circle_of_modules_is_seen(planted: Callable[[str, str], Graph]) -> None:
    assert set(circle(planted("app/lower/d.py", "import app.lower.c\n"))) == {"app.lower.c", "app.lower.d"}


def test_a_package_without_a_level_is_seen(planted: Callable[[str, str], Graph]) -> None:
    assert upward(planted("app/upper/b.py", ""), "app", (("upper",),)) == ["app.upper.a -> app.lower.c"]
