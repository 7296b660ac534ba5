"""Copy of the checkout in which sources are changed; the checkout itself is only read."""

from __future__ import annotations

import compileall
import contextlib
import fnmatch
import hashlib
import json
import py_compile
import re
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.mutants.names import Names, Node, module_name
from benchmarks.mutants.nearest import Tests
from benchmarks.mutants.sites import Site, changed
from benchmarks.mutants.trial import Plan

IGNORED = (".*", "__pycache__", "build", "dist", "site", "demo-out", "runs", "*.egg-info")
"""Names that are not copied."""
FEW = 6
"""Maximum number of affected kernels that are recompiled, a second or two each; more of them run as Python.
"""


@dataclass(frozen=True)
class Change:
    """One change of one file.

    Attributes:
        file: Path of the file, relative to the tree.
        site: The change.
    """

    file: Path
    site: Site


class Tree:
    """Copy of the checkout, with data on its names and tests.

    Args:
        checkout: The checkout to copy.
        work: Folder for the copy, its kernels and its passing files.
        package: Importable name of the package that is changed.
    """

    def __init__(self, checkout: Path, work: Path, package: str) -> None:
        self.work, self.root = work.resolve(), work.resolve() / "tree"
        shutil.rmtree(self.root, ignore_errors=True)
        shutil.copytree(checkout, self.root, ignore=shutil.ignore_patterns(*IGNORED))
        # by hash: a change may leave size and second of modification alone
        hashed = py_compile.PycInvalidationMode.CHECKED_HASH
        compileall.compile_dir(self.root, quiet=2, invalidation_mode=hashed)
        files = sorted((self.root / package).rglob("*.py"))
        self.names = Names(self.root, files)
        self.tests = Tests(self.root, self.names)
        self.digest = hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:16]
        self.kernels, self.scratch = self.work / f"kernels-{self.digest}", self.work / "scratch"

    def sources(self, patterns: Sequence[str]) -> dict[Path, str]:
        """Return the sources of the files whose path matches one of the patterns."""
        paths = sorted(path.relative_to(self.root) for path in self.root.rglob("*.py"))
        wanted = [path for path in paths if any(fnmatch.fnmatch(str(path), one) for one in patterns)]
        return {path: (self.root / path).read_text() for path in wanted}

    def nodes(self, change: Change) -> set[Node]:
        """Return the names whose definitions contain a change."""
        module = module_name(change.file)
        return {(module, name) for name in self.names.modules[module].at(change.site.line)} or {(module, "")}

    def needed(self) -> set[str]:
        """Return the first names of all modules that the tree imports."""
        found = set[str]()
        for path in self.root.rglob("*.py"):
            found.update(re.findall(r"^\s*(?:from|import)\s+(\w+)", path.read_text(), re.MULTILINE))
        return found

    def plan(self, change: Change, seconds: float, per_test: float) -> Plan:
        """Return the plan of the tests of a change: affected kernels, and whether they are compiled."""
        kernels = self.names.compiled(self.names.affected(self.nodes(change)))
        affected = frozenset(f"{module}:{name}" for module, name in kernels)
        told = {"kernels": str(self.kernels), "scratch": str(self.scratch), "affected": sorted(affected)}
        file = self.work / "plan.json"
        file.write_text(json.dumps(told))
        return Plan(self.root, file, affected, len(affected) > FEW, seconds, per_test)

    @contextlib.contextmanager
    def holding(self, change: Change) -> Iterator[None]:
        """Apply a change to the tree while the block runs."""
        path = self.root / change.file
        before = path.read_text()
        path.write_text(changed(before, change.site))
        try:
            yield
        finally:
            path.write_text(before)
            shutil.rmtree(self.scratch, ignore_errors=True)
