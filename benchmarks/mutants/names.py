"""Graph of the names in a package's modules and the names that each uses, read from the source.

A node is a name at the level of a module, or a module itself (its name is then empty).  An edge leads from a
name to every name that its definition mentions, through imports.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

Node = tuple[str, str]
COMPILERS = {"kernel", "separate", "jit", "within", "cfunc", "njit", "vectorize", "intrinsic"}
"""Decorators and functions whose result is compiled by Numba."""


@dataclass(frozen=True)
class Module:
    """Names of one module.

    Attributes:
        path: File of the module.
        uses: Names mentioned in each name's definition.
        compiled: Functions that Numba compiles.
        made: Names whose value a function of the module compiles from generated source.
        imports: Modules that are imported, in functions too.
        lines: First and last line of each definition, with its name.
    """

    path: Path
    uses: dict[str, set[Node]] = field(default_factory=dict)
    compiled: set[str] = field(default_factory=set)
    made: set[str] = field(default_factory=set)
    imports: set[str] = field(default_factory=set)
    lines: list[tuple[int, int, str]] = field(default_factory=list)

    def at(self, line: int) -> set[str]:
        """Return the names that are defined at a line."""
        return {name for first, last, name in self.lines if first <= line <= last}


class Names:
    """The graph of a package.

    Args:
        root: Folder that holds the package.
        files: Its files.
    """

    def __init__(self, root: Path, files: Iterable[Path]) -> None:
        paths = {module_name(path.relative_to(root)): path for path in files}
        self.modules = {name: _module(name, path, paths) for name, path in paths.items()}

    @cached_property
    def users(self) -> Mapping[Node, set[Node]]:
        """Reversed edges: for each name, the names that mention it."""
        found: dict[Node, set[Node]] = {}
        for module, content in self.modules.items():
            for name, uses in content.uses.items():
                found.setdefault((module, name), set()).add((module, ""))
                for used in self._compiled_under(uses) if name in content.made else uses:
                    found.setdefault(used, set()).add((module, name))
        return found

    def affected(self, start: Iterable[Node]) -> set[Node]:
        """Return the names whose meaning may change if any of the given names changes."""
        return _reached(start, lambda node: self.users.get(node, set()))

    def compiled(self, nodes: Iterable[Node]) -> set[Node]:
        """Return those of the given names that Numba compiles."""
        return {
            (module, name)
            for module, name in nodes
            if module in self.modules
            and (name in self.modules[module].compiled or name in self.modules[module].made)
        }

    def _compiled_under(self, start: Iterable[Node]) -> set[Node]:
        """Return the compiled functions that the given names use, directly or through other names."""

        def uses(node: Node) -> set[Node]:
            module = self.modules.get(node[0])
            if module is None:
                return set()
            if not node[1]:
                return {(node[0], name) for name in module.uses}
            return module.uses.get(node[1], set())

        return {node for node in _reached(start, uses) if self.compiled([node])}


def module_name(path: Path) -> str:
    """Return the dotted name of a file in a package."""
    parts = path.with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _reached(start: Iterable[Node], following: object) -> set[Node]:
    waiting, found = list(start), set[Node]()
    while waiting:
        node = waiting.pop()
        if node not in found:
            found.add(node)
            waiting += following(node)  # type: ignore[operator]
    return found


def _module(name: str, path: Path, paths: Mapping[str, Path]) -> Module:
    """Return the names of one module, read from its file."""
    tree = ast.parse(path.read_text())
    module, bound = Module(path), dict[str, Node]()
    for node in ast.walk(tree):
        for local, target in _imported(node, name, path, paths):
            bound[local] = target
            module.imports.add(target[0])
            if target[1] and f"{target[0]}.{target[1]}" in paths:
                module.imports.add(f"{target[0]}.{target[1]}")
    for local, target in bound.items():
        module.uses[local] = {_node(target, paths)}
    own = {defined for statement in tree.body for defined in _defined(statement)}
    for statement in tree.body:
        uses = {
            (name, mentioned) if mentioned in own else _node(bound[mentioned], paths)
            for mentioned in _mentioned(statement, bound, paths)
            if mentioned in own or mentioned in bound
        } | {
            (_node(bound[base], paths)[0], attribute)
            for base, attribute in _attributes(statement)
            if base in bound and not _node(bound[base], paths)[1]
        }
        for defined in _defined(statement):
            module.uses[defined] = module.uses.get(defined, set()) | uses
            module.lines.append((_first(statement), statement.end_lineno or statement.lineno, defined))
            if _is_compiled(statement):
                module.compiled.add(defined)
    makers = {
        statement.name
        for statement in tree.body
        if isinstance(statement, ast.FunctionDef)
        and any(isinstance(n, ast.Name) and n.id in COMPILERS for s in statement.body for n in ast.walk(s))
    }
    for statement in tree.body:
        value = getattr(statement, "value", None)
        if isinstance(value, ast.Call) and isinstance(value.func, ast.Name) and value.func.id in makers:
            module.made.update(_defined(statement))
    return module


def _node(target: Node, paths: Mapping[str, Path]) -> Node:
    """Return the target of an import: a module, or a name of one."""
    whole = f"{target[0]}.{target[1]}"
    return (whole, "") if target[1] and whole in paths else target


def _imported(node: ast.AST, name: str, path: Path, paths: Mapping[str, Path]) -> Iterator[tuple[str, Node]]:
    """Yield the local names that an import statement binds to modules of the package."""
    if isinstance(node, ast.ImportFrom):
        origin = node.module or ""
        if node.level:
            parts = name.split(".")
            here = parts if path.name == "__init__.py" else parts[:-1]
            base = here[: len(here) - node.level + 1]
            origin = ".".join([*base, *filter(None, [node.module])])
        for one in node.names:
            if origin in paths or f"{origin}.{one.name}" in paths:
                yield one.asname or one.name, (origin, one.name)
    elif isinstance(node, ast.Import):
        for one in node.names:
            if one.name in paths:
                yield one.asname or one.name, (one.name, "")


def _defined(statement: ast.stmt) -> set[str]:
    """Return the names that a statement of a module defines."""
    if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        return {statement.name}
    within = {
        node
        for each in ast.walk(statement)
        if isinstance(each, ast.comprehension | ast.FunctionDef | ast.ClassDef | ast.Lambda)
        for node in ast.walk(each)
    }
    return {
        node.id
        for node in ast.walk(statement)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node not in within
    }


def _mentioned(statement: ast.stmt, bound: Mapping[str, Node], paths: Mapping[str, Path]) -> set[str]:
    """Return the names that a statement mentions, except modules of which it takes an attribute."""
    modules = {local for local, target in bound.items() if not _node(target, paths)[1]}
    through = {
        node.value
        for node in ast.walk(statement)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in modules
    }
    return {node.id for node in ast.walk(statement) if isinstance(node, ast.Name) and node not in through}


def _attributes(statement: ast.stmt) -> Iterator[tuple[str, str]]:
    for node in ast.walk(statement):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            yield node.value.id, node.attr


def _first(statement: ast.stmt) -> int:
    decorators = getattr(statement, "decorator_list", [])
    return min([statement.lineno, *(one.lineno for one in decorators)])


def _is_compiled(statement: ast.stmt) -> bool:
    """Return whether a statement defines a compiled function, by its decorator or by a call."""
    if isinstance(statement, ast.FunctionDef):
        said: list[ast.expr] = statement.decorator_list
    elif isinstance(statement, ast.Assign) and isinstance(statement.value, ast.Call):
        said = [statement.value.func]
    else:
        return False
    return any(
        name in COMPILERS
        for one in said
        for node in ast.walk(one)
        for name in (getattr(node, "id", None), getattr(node, "attr", None))
    )
