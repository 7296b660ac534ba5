"""Small changes of Python source: one operator, constant or term at a time.

A change keeps every line where it is, so that line numbers agree with the original.  Docstrings, annotations,
messages of errors, warnings and logs, assertions, `strict` of zip, `repr` of fields and `__all__` are not
changed: no test should depend on them.
"""

from __future__ import annotations

import ast
import bisect
import io
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass

BINARY: dict[type[ast.operator], tuple[str, str]] = {
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
    ast.FloorDiv: ("//", "*"),
    ast.Mod: ("%", "*"),
    ast.Pow: ("**", "*"),
    ast.BitAnd: ("&", "|"),
    ast.BitOr: ("|", "&"),
    ast.BitXor: ("^", "|"),
}
"""Operator of each node, and its replacement."""
TERMS = (ast.Add, ast.Sub, ast.Mult, ast.Div)
"""Operators whose right operand may be dropped."""
COMPARISONS: dict[type[ast.cmpop], tuple[str, tuple[str, ...]]] = {
    ast.Lt: ("<", ("<=", ">")),
    ast.LtE: ("<=", ("<", ">")),
    ast.Gt: (">", (">=", "<")),
    ast.GtE: (">=", (">", "<")),
    ast.Eq: ("==", ("!=",)),
    ast.NotEq: ("!=", ("==",)),
    ast.Is: ("is", ("is not",)),
    ast.IsNot: ("is not", ("is",)),
    ast.In: ("in", ("not in",)),
    ast.NotIn: ("not in", ("in",)),
}
"""Comparison of each node, and its replacements: its boundary moved, or its sense reversed."""
NAMES = {
    **{"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum"},
    **{"any": "all", "all": "any", "sin": "cos", "cos": "sin", "floor": "ceil", "ceil": "floor"},
    **{"argmin": "argmax", "argmax": "argmin", "zeros": "ones", "ones": "zeros"},
}
"""Functions and methods that are swapped where they are called."""
SAYING = {"warn", "warning", "info", "debug", "error", "exception", "print", "log", "step", "echo"}
"""Functions and methods whose arguments are messages to people."""


GUARDS = {"strict", "repr"}
"""Keywords whose values are left alone."""


@dataclass(frozen=True)
class Site:
    """One change of a source file.

    Attributes:
        line: Line of the change, from 1.
        start: Begin of the text to replace, as an index into the source.
        stop: End of the text to replace.
        new: Replacement text.
        kind: `operator`, `comparison`, `condition`, `constant`, `term` or `function`.
        within: Qualified name of the enclosing function; empty at the level of the module.
    """

    line: int
    start: int
    stop: int
    new: str
    kind: str
    within: str


def changed(source: str, site: Site) -> str:
    """Return the source with one change."""
    return source[: site.start] + site.new + source[site.stop :]


def sites(source: str) -> list[Site]:
    """Return every allowed change of a source, in order of place."""
    return sorted(_Finder(source).of(ast.parse(source)), key=lambda site: (site.start, site.stop, site.new))


def valid(source: str, site: Site) -> bool:
    """Return whether the changed source parses and means something else than the original."""
    try:
        return ast.dump(ast.parse(changed(source, site))) != ast.dump(ast.parse(source))
    except SyntaxError:
        return False


class _Finder:
    """Walk of a syntax tree that knows where its operators stand in the text."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.starts = [0]
        for line in source.splitlines(keepends=True):
            self.starts.append(self.starts[-1] + len(line))
        self.lines = [line.encode() for line in source.splitlines(keepends=True)]
        tokens = tokenize.generate_tokens(io.StringIO(source).readline)
        self.tokens = [
            (self.starts[t.start[0] - 1] + t.start[1], t.string)
            for t in tokens
            if t.type in (tokenize.OP, tokenize.NAME)
        ]

    def of(self, node: ast.AST, within: str = "") -> Iterator[Site]:
        """Yield the changes in a node of the syntax tree and below."""
        if self._left_alone(node):
            return
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            inner = f"{within}.{node.name}" if within else node.name
            defaults = [] if isinstance(node, ast.ClassDef) else [*node.args.defaults, *node.args.kw_defaults]
            for default in defaults:
                if default is not None:
                    yield from self.of(default, within)
            for statement in node.body:
                yield from self.of(statement, inner)
            return
        if isinstance(node, ast.AnnAssign):
            if node.value is not None:
                yield from self.of(node.value, within)
            return
        if isinstance(node, ast.expr | ast.stmt):
            yield from self._here(node, within)
        for child in ast.iter_child_nodes(node):
            yield from self.of(child, within)

    def _left_alone(self, node: ast.AST) -> bool:
        """Return whether nothing in a node is changed."""
        if isinstance(node, ast.Assert | ast.Raise | ast.Import | ast.ImportFrom | ast.JoinedStr):
            return True
        if isinstance(node, ast.Assign):
            return any(isinstance(target, ast.Name) and target.id == "__all__" for target in node.targets)
        if isinstance(node, ast.keyword):
            return node.arg in GUARDS
        if isinstance(node, ast.If):
            return isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
        if isinstance(node, ast.Call):
            name = _called(node)
            return name in SAYING or name.endswith(("Error", "Warning")) or name in ("isinstance", "cast")
        return False

    def _here(self, node: ast.expr | ast.stmt, within: str) -> Iterator[Site]:
        """Yield the changes of one node."""

        def site(start: int, stop: int, new: str, kind: str) -> Site:
            return Site(bisect.bisect_right(self.starts, start), start, stop, new, kind, within)

        if isinstance(node, ast.BinOp) and type(node.op) in BINARY:
            old, new = BINARY[type(node.op)]
            at = self._token(old, self._end(node.left), self._start(node.right))
            if at is not None:
                yield site(at, at + len(old), new, "operator")
                if isinstance(node.op, TERMS) and not isinstance(node.right, ast.Constant):
                    gone = self.source[at : self._end(node)]
                    yield site(at, self._end(node), "\n" * gone.count("\n"), "term")
        elif isinstance(node, ast.AugAssign) and type(node.op) in BINARY:
            old, new = (f"{sign}=" for sign in BINARY[type(node.op)])
            at = self._token(old, self._end(node.target), self._start(node.value))
            if at is not None:
                yield site(at, at + len(old), new, "operator")
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
            if not isinstance(node.operand, ast.Constant):
                kind = "operator" if isinstance(node.op, ast.USub) else "condition"
                yield site(self._start(node), self._start(node.operand), "", kind)
        elif isinstance(node, ast.Compare):
            left = node.left
            for op, right in zip(node.ops, node.comparators, strict=True):
                old, choices = COMPARISONS[type(op)]
                at = self._token(old.split()[0], self._end(left), self._start(right))
                if at is not None:
                    stop = at + len(old) if " " not in old else self._after(old, at)
                    for new in choices:
                        yield site(at, stop, new, "comparison")
                left = right
        elif isinstance(node, ast.BoolOp):
            old, new = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
            for left, right in zip(node.values[:-1], node.values[1:], strict=True):
                at = self._token(old, self._end(left), self._start(right))
                if at is not None:
                    yield site(at, at + len(old), new, "condition")
        elif isinstance(node, ast.If | ast.IfExp | ast.While) and isinstance(
            node.test, ast.Name | ast.Attribute
        ):
            yield site(self._start(node.test), self._start(node.test), "not ", "condition")
        elif isinstance(node, ast.Constant) and not isinstance(node.value, str | bytes):
            if (new := other(node.value, self.source[self._start(node) : self._end(node)])) is not None:
                yield site(self._start(node), self._end(node), new, "constant")
        elif isinstance(node, ast.Call) and _called(node) in NAMES:
            name, stop = _called(node), self._end(node.func)
            yield site(stop - len(name), stop, NAMES[name], "function")

    def _token(self, text: str, start: int, stop: int) -> int | None:
        """Return the place of an operator between its operands."""
        first = bisect.bisect_left(self.tokens, (start, ""))
        for at, token in self.tokens[first:]:
            if at >= stop:
                return None
            if token == text:
                return at
        return None

    def _after(self, two: str, at: int) -> int:
        """Return the end of an operator of two words."""
        last = two.split()[1]
        return next(a for a, token in self.tokens if a > at and token == last) + len(last)

    def _start(self, node: ast.expr | ast.stmt) -> int:
        return self._offset(node.lineno, node.col_offset)

    def _end(self, node: ast.expr | ast.stmt) -> int:
        return self._offset(node.end_lineno or node.lineno, node.end_col_offset or 0)

    def _offset(self, line: int, column: int) -> int:
        """Return an index in characters for a line and a column in bytes, as the syntax tree counts."""
        return self.starts[line - 1] + len(self.lines[line - 1][:column].decode())


def _called(node: ast.Call) -> str:
    """Return the last name of a call's function; empty if it has none."""
    if isinstance(node.func, ast.Attribute):
        return node.func.attr
    return node.func.id if isinstance(node.func, ast.Name) else ""


def other(value: object, text: str) -> str | None:
    """Return the text of another constant: a negated switch, the next integer, twice a number.

    For a power of ten it is 1.  A number written with an exponent is a tolerance or a limit, and doubling it
    is not a relevant mistake.
    """
    if isinstance(value, bool):
        return str(not value)
    if isinstance(value, int):
        return str(value + 1)
    if isinstance(value, float):
        if "e" in text.lower():
            return "1.0"
        return repr(2.0 * value) if value else "1.0"
    return None
