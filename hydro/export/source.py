"""Source of functions with all that they call, as one module without imports of hydro.

Kernels are copied from their modules, with their docstrings, so the export runs the same code as `simulate`.
Decorators, annotations and comments are removed.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import sys
import textwrap
from collections.abc import Callable, Iterator
from functools import cache
from types import ModuleType
from typing import Any

from hydro.core.errors import HydroError

Definition = ast.FunctionDef | ast.ClassDef


@cache
def definition(function: Callable[..., Any]) -> Definition:
    """Return the syntax tree of a function, kernel or class, without decorators and annotations.

    The attribute `size` of a vector is replaced by `len`, so that the code accepts lists.
    """
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(plain(function)))).body
    assert isinstance(tree, ast.FunctionDef | ast.ClassDef)
    found: Definition = ast.fix_missing_locations(_RemoveTypes().visit(tree))
    return found


def plain(function: Any) -> Any:
    """Return the Python function that a compiled kernel wraps; anything else is returned as it is."""
    return getattr(function, "py_func", function)


def module_names(thing: Callable[..., Any]) -> dict[str, Any]:
    """Return the global names, with their values, of the module that defines a function or class."""
    if inspect.isclass(thing):
        return vars(sys.modules[thing.__module__])
    around: dict[str, Any] = plain(thing).__globals__
    return around


def in_docstring(text: str) -> str:
    """Return a text escaped for use between triple quotes, on one line."""
    return "".join(
        f"\\{one}" if one in '\\"' else one if one.isprintable() else repr(one)[1:-1] for one in text
    )


def is_ours(value: Any) -> bool:
    """Return whether a value is a function or class of hydro."""
    callable_ = inspect.isfunction(plain(value)) or inspect.isclass(value)
    return callable_ and (plain(value).__module__ or "").startswith("hydro.")


class _RemoveTypes(ast.NodeTransformer):
    """Transformer that removes types and numpy attributes."""

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.FunctionDef:
        node.decorator_list, node.returns = [], None
        for argument in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs):
            argument.annotation = None
        self.generic_visit(node)
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        self.generic_visit(node)
        if node.value is None:
            return ast.Pass()
        return ast.Assign([node.target], node.value)

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        self.generic_visit(node)
        if node.attr == "size" and isinstance(node.ctx, ast.Load):
            return ast.Call(ast.Name("len", ast.Load()), [node.value], [])
        return node


class Bundle:
    """Collector of functions and classes, in the order of their use, that become one Python module.

    Attributes:
        constants: Numbers by name.
        definitions: Sources of functions and classes by name.
    """

    def __init__(self) -> None:
        self.constants: dict[str, Any] = {}
        self.definitions: dict[str, str] = {}
        self._named: dict[Any, str] = {}

    def add(self, thing: Any, name: str = "") -> str:
        """Add a function, kernel or class to the module, with all that it uses.

        Return its name in the module.

        Args:
            thing: Function, kernel or class.
            name: Name in the module; by default the name of the thing itself.
        """
        known = plain(thing)
        if known not in self._named:
            self._named[known] = self._unused(name or known.__name__, known)
            tree = ast.parse(ast.unparse(definition(thing))).body[0]  # a copy, because it will be renamed
            assert isinstance(tree, ast.FunctionDef | ast.ClassDef)
            _Rename(self._names_in(tree, module_names(thing))).visit(tree)
            tree.name = self._named[known]
            self.definitions[tree.name] = ast.unparse(tree)
        return self._named[known]

    def text(self) -> str:
        """Return the source text of the module, without its docstring."""
        constants = "\n".join(f"{name} = {value!r}" for name, value in self.constants.items())
        return "\n\n\n".join(["import math", constants, *self.definitions.values()])

    def _names_in(self, tree: Definition, around: dict[str, Any]) -> dict[str, str]:
        """Return the new name of each global name in a definition; attributes of modules as `module.name`.

        Args:
            tree: The definition.
            around: Global names of the definition's module.
        """
        found = {}
        for name, value in _globals(tree, around):
            if value is math or value is Any or _is_hydro(value):
                continue
            if is_ours(value):
                found[name] = self.add(value)
            elif isinstance(value, int | float | slice):
                found[name] = self._constant(name.rpartition(".")[2], value)
            else:
                raise HydroError(f"{tree.name} uses {name}, which cannot be written out")
        return found

    def _constant(self, name: str, value: Any) -> str:
        """Add a number to the constants of the module, and return its name there."""
        while self.constants.get(name, value) != value or name in self.definitions:
            name += "_"
        self.constants[name] = value
        return name

    def _unused(self, name: str, thing: Any) -> str:
        """Return a name for a thing, prefixed with its module's name if the plain name is already used."""
        taken = {*self._named.values(), *self.constants}
        return name if name not in taken else f"{thing.__module__.rpartition('.')[2]}_{name}"


def _globals(tree: Definition, around: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield the global names that a definition reads, and attributes of hydro's modules."""
    names = [node for node in ast.walk(tree) if isinstance(node, ast.Name)]
    own = {node.id for node in names if isinstance(node.ctx, ast.Store)}
    own |= {node.arg for node in ast.walk(tree) if isinstance(node, ast.arg)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            module = around.get(node.value.id)
            if node.value.id not in own and _is_hydro(module):
                yield f"{node.value.id}.{node.attr}", getattr(module, node.attr)
        elif isinstance(node, ast.Name) and node.id not in own and node.id in around:
            yield node.id, around[node.id]
        elif isinstance(node, ast.Name) and node.id not in own and not hasattr(builtins, node.id):
            raise HydroError(f"{tree.name} uses {node.id}, which cannot be written out")


def _is_hydro(module: Any) -> bool:
    return isinstance(module, ModuleType) and module.__name__.startswith("hydro.")


class _Rename(ast.NodeTransformer):
    """Transformer that replaces names by those in the module."""

    def __init__(self, names: dict[str, str]) -> None:
        self.names = names

    def visit_Name(self, node: ast.Name) -> ast.AST:
        node.id = self.names.get(node.id, node.id)
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        if isinstance(node.value, ast.Name) and (name := self.names.get(f"{node.value.id}.{node.attr}")):
            return ast.Name(name, node.ctx)
        self.generic_visit(node)
        return node
