"""Selection of tests for a change, nearest first, by the imports of test files."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks.mutants.names import Names, Node

FARTHEST = 3
"""Longest chain of imports from a test file to the changed module."""


@dataclass(frozen=True)
class TestFile:
    """Imports of one file of tests.

    Attributes:
        path: Path of the file, relative to the tree.
        direct: Modules of the package that it imports itself.
        helped: Modules that its helpers import.
        words: Names and attributes that it mentions.
        size: Length of its source.
        digest: Hash of its source.
    """

    __test__ = False

    path: Path
    direct: frozenset[str]
    helped: frozenset[str]
    words: frozenset[str]
    size: int
    digest: str


class Tests:
    """All files of tests of a tree.

    Args:
        root: The tree.
        names: Names of its package.
        folder: Folder of the tests.
    """

    __test__ = False

    def __init__(self, root: Path, names: Names, folder: str = "tests") -> None:
        self.names, self.folder = names, folder
        sources = {path.relative_to(root): path.read_text() for path in sorted((root / folder).rglob("*.py"))}
        trees = {path: ast.parse(source) for path, source in sources.items()}
        helpers = {path.stem: path for path in trees if not path.name.startswith("test_")}
        imports = {path: frozenset(_modules(tree, names)) for path, tree in trees.items()}
        beside = {path: set(_helpers(tree, helpers)) for path, tree in trees.items()}
        self.files = [
            TestFile(
                path,
                imports[path],
                frozenset(module for helper in _all(path, beside) for module in imports[helper]),
                frozenset(_words(tree)),
                len(sources[path]),
                hashlib.sha256(sources[path].encode()).hexdigest()[:16],
            )
            for path, tree in trees.items()
            if path.name.startswith("test_")
        ]

    def nearest(self, nodes: Iterable[Node]) -> list[Path]:
        """Return the test files to run for a change of names of one module, nearest first.

        First those named after the module, then those that import it and mention a name that the change
        reaches within it, then by the length of the chain of imports; a file in the same place of the tree
        comes before one elsewhere, and a small one before a large one.
        """
        start = list(nodes)
        module = start[0][0]
        reached = {name for other, name in self.names.affected(start) if other == module and name}
        away = self._away(module)
        mirror = Path(self.folder, *module.split(".")[1:-1])
        stem = f"test_{module.split('.')[-1]}"
        ranked = []
        for file in self.files:
            steps = min((away[m] for m in file.direct if m in away), default=FARTHEST + 1)
            helped = min((away[m] + 1 for m in file.helped if m in away), default=FARTHEST + 1)
            near = min(steps, helped)
            if near > FARTHEST:
                continue
            same, named = file.path.parent == mirror, file.path.stem
            if same and named == stem:
                rank = 0
            elif steps == 0 and file.words & reached:
                rank = 1
            elif same and named.startswith(stem):
                rank = 2
            else:
                rank = 3 + near
            ranked.append((rank, not same, not file.path.is_relative_to(mirror), file.size, file.path))
        return [path for *_, path in sorted(ranked)]

    def _away(self, module: str) -> dict[str, int]:
        """Return the number of imports from each module to the given one, by module."""
        found, edge = {module: 0}, {module}
        for steps in range(1, FARTHEST + 1):
            edge = {
                name
                for name, content in self.names.modules.items()
                if name not in found and content.imports & edge
            }
            found |= dict.fromkeys(edge, steps)
        return found


def _modules(tree: ast.Module, names: Names) -> Iterator[str]:
    """Yield the modules of the package that a file imports; for a package, the modules of its names."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (one.name for one in node.names if one.name in names.modules)
        elif isinstance(node, ast.ImportFrom) and node.module:
            for one in node.names:
                whole = f"{node.module}.{one.name}"
                if whole in names.modules:
                    yield whole
                elif node.module in names.modules:
                    yield node.module
                    uses = names.modules[node.module].uses.get(one.name, set())
                    yield from (origin for origin, _ in uses if origin != node.module)


def _helpers(tree: ast.Module, helpers: dict[str, Path]) -> Iterator[Path]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            stems = [one.name.split(".")[-1] for one in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            stems = [node.module.split(".")[-1]]
        else:
            continue
        yield from (helpers[stem] for stem in stems if stem in helpers)


def _all(path: Path, beside: dict[Path, set[Path]]) -> set[Path]:
    """Return the helper files of a test file, and the helpers of these."""
    waiting, found = [*beside[path]], set[Path]()
    while waiting:
        helper = waiting.pop()
        if helper not in found:
            found.add(helper)
            waiting += beside[helper]
    return found - {path}


def _words(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Name):
            yield node.id
        elif isinstance(node, ast.Attribute):
            yield node.attr
        elif isinstance(node, ast.alias):
            yield node.name
