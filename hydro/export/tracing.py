"""Tracing of numeric functions with symbols: from the source of kernels to symbolic expressions.

A kernel is scalar code: sums, products, `math`, loops over known ranges, and branches.  Known values
(parameters, constants, indices) are computed as in Python.  If a branch depends on a symbol, both sides run,
and a selection joins their results.  If a side returns, it includes the rest of the function.
"""

from __future__ import annotations

import ast
import copy
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any, Protocol

from hydro.core.errors import HydroError
from hydro.export.source import Definition, definition, is_ours, module_names, plain

Environment = dict[str, Any]


class Algebra(Protocol):
    """Interface of a library of symbols, such as CasADi, for the tracing.

    Attributes:
        functions: Replacements of Python's functions and of some of hydro's.
    """

    functions: Mapping[Any, Callable[..., Any]]

    def is_symbol(self, value: Any) -> bool:
        """Return whether a value is a symbol."""

    def select(self, test: Any, yes: Any, no: Any) -> Any:
        """Return `yes` where the symbolic condition `test` holds, otherwise `no`."""

    def both(self, one: Any, other: Any) -> Any:
        """Return a symbolic condition that holds if both given conditions hold."""

    def negated(self, one: Any) -> Any:
        """Return a symbolic condition that holds if the given condition does not hold."""


class _Returned:
    """Marker of a `return` with its value."""

    def __init__(self, value: Any) -> None:
        self.value = value


_NORMAL, _BREAK, _CONTINUE = object(), object(), object()  # ends of a run of statements, besides `return`


class Tracer:
    """Interpreter that runs numeric functions on symbols, and so returns symbolic expressions."""

    def __init__(self, algebra: Algebra) -> None:
        self.algebra = algebra

    def call(self, function: Any, *given: Any) -> Any:
        """Return the result of a function called with numbers and symbols.

        Lists that it writes to are changed.

        Args:
            function: Function or kernel of hydro, or a Python function in `Algebra.functions`.
            given: Its arguments.

        Raises:
            HydroError: The function is not scalar code.
        """
        known = plain(function)
        if known in self.algebra.functions:
            return self.algebra.functions[known](*given)
        if not is_ours(function):
            return function(*given)
        tree = _prepared(known)
        assert isinstance(tree, ast.FunctionDef)
        names = [argument.arg for argument in tree.args.args]
        end = self._run(tree.body, dict(zip(names, given, strict=True)), module_names(known))
        return end.value if isinstance(end, _Returned) else None

    def _run(self, statements: Sequence[ast.stmt], here: Environment, around: Mapping[str, Any]) -> Any:
        """Run statements; return their end: normal, by `return` with its value, or by `break` or `continue`.

        Args:
            statements: Statements of a function.
            here: Local names with their values, changed in place.
            around: Global names of the function's module.
        """
        for place, statement in enumerate(statements):
            if isinstance(statement, ast.If):
                test = self._value(statement.test, here, around)
                rest = statements[place + 1 :]
                if not self.algebra.is_symbol(test):
                    return self._run([*(statement.body if test else statement.orelse), *rest], here, around)
                sides = statement.body, statement.orelse
                if any(_may_leave(side) for side in sides):
                    return self._split(test, [[*side, *rest] for side in sides], here, around)
                self._split(test, list(sides), here, around)
            elif isinstance(statement, ast.For):
                if (end := self._loop(statement, here, around)) is not _NORMAL:
                    return end
            elif isinstance(statement, ast.Return):
                return _Returned(
                    None if statement.value is None else self._value(statement.value, here, around)
                )
            elif isinstance(statement, ast.Break | ast.Continue):
                return _BREAK if isinstance(statement, ast.Break) else _CONTINUE
            elif isinstance(statement, ast.Assign):
                value = self._value(statement.value, here, around)
                for target in statement.targets:
                    self._assign(target, value, here, around)
            elif isinstance(statement, ast.AugAssign):
                self._assign(statement.target, self._value(_sum_of(statement), here, around), here, around)
            elif isinstance(statement, ast.Expr):
                self._value(statement.value, here, around)
            elif not isinstance(statement, ast.Pass):
                raise HydroError(f"{ast.unparse(statement)!r:.80} cannot be run on symbols")
        return _NORMAL

    def _loop(self, loop: ast.For, here: Environment, around: Mapping[str, Any]) -> Any:
        """Run a loop over known values."""
        for value in self._value(loop.iter, here, around):
            self._assign(loop.target, value, here, around)
            end = self._run(loop.body, here, around)
            if end is _BREAK:
                break
            if isinstance(end, _Returned):
                return end
        return _NORMAL

    def _split(
        self, test: Any, sides: Sequence[Sequence[ast.stmt]], here: Environment, around: Mapping[str, Any]
    ) -> Any:
        """Run both sides of a branch on a symbol from one state; join their assignments and results.

        Args:
            test: Condition, a symbol.
            sides: Statements if the condition holds, and if it does not.
            here: Local names with their values, changed in place.
            around: Global names of the function's module.
        """
        lists = list(_lists(here.values()))
        before, ends, after = [list(one) for one in lists], [], []
        for side in sides:
            there = dict(here)
            ends.append(self._run(side, there, around))
            after.append((there, [list(one) for one in lists]))
            for one, values in zip(lists, before, strict=True):
                one[:] = values
        (yes, yes_lists), (no, no_lists) = after
        for one, values, others in zip(lists, yes_lists, no_lists, strict=True):
            one[:] = self._select_entries(test, values, others)
        for name in yes.keys() & no.keys():
            here[name] = self._select_entries(test, yes[name], no[name])
        if ends == [_NORMAL, _NORMAL]:
            return _NORMAL
        if _BREAK in ends or _CONTINUE in ends:
            raise HydroError("a loop that ends on a symbolic condition cannot be traced")
        values = [end.value if isinstance(end, _Returned) else None for end in ends]
        return _Returned(self._select_entries(test, *values))

    def _select_entries(self, test: Any, yes: Any, no: Any) -> Any:
        """Select `yes` or `no` by a symbolic condition, entry by entry for lists and tuples of one length."""
        if yes is no:
            return yes
        if isinstance(yes, list | tuple) and isinstance(no, list | tuple) and len(yes) == len(no):
            return type(yes)(self._select_entries(test, a, b) for a, b in zip(yes, no, strict=True))
        return self.algebra.select(test, yes, no)

    def _assign(self, target: ast.expr, value: Any, here: Environment, around: Mapping[str, Any]) -> None:
        """Assign to a name, to several names, or to an entry of a list."""
        if isinstance(target, ast.Name):
            here[target.id] = value
        elif isinstance(target, ast.Tuple):
            for one, part in zip(target.elts, value, strict=True):
                self._assign(one, part, here, around)
        elif isinstance(target, ast.Subscript):
            self._value(target.value, here, around)[self._value(target.slice, here, around)] = value
        else:
            raise HydroError(f"{ast.unparse(target)!r:.80} cannot be written to")

    def _value(self, expression: ast.expr, here: Environment, around: Mapping[str, Any]) -> Any:
        """Evaluate an expression."""
        tools = {"_call": self.call, "_select": self._select, "_both": self._both, "_not": self._negated}
        return eval(_compiled(expression), {**around, **tools, **here})

    def _select(self, test: Any, yes: Callable[[], Any], no: Callable[[], Any]) -> Any:
        """Evaluate `yes if test else no`; both sides if the test is a symbol."""
        if self.algebra.is_symbol(test):
            return self.algebra.select(test, yes(), no())
        return yes() if test else no()

    def _both(self, one: Any, other: Callable[[], Any]) -> Any:
        """Evaluate `one and other`; both operands if the first is a symbol."""
        if self.algebra.is_symbol(one):
            return self.algebra.both(one, other())
        return other() if one else one

    def _negated(self, one: Any) -> Any:
        """Evaluate `not one`."""
        return self.algebra.negated(one) if self.algebra.is_symbol(one) else not one


@cache
def _sum_of(statement: ast.AugAssign) -> ast.expr:
    """Return the expression `x + y` of a statement `x += y`."""
    load = copy.copy(statement.target)
    load.ctx = ast.Load()
    whole = ast.copy_location(ast.BinOp(load, statement.op, statement.value), statement)
    return ast.fix_missing_locations(whole)


@cache
def _prepared(function: Any) -> Definition:
    """Return the syntax tree of a function whose calls, conditions and `and`, `or`, `not` call the tracer."""
    tree = _TracerCalls().visit(copy.deepcopy(definition(function)))
    found: Definition = ast.fix_missing_locations(tree)
    return found


@cache
def _compiled(expression: ast.expr) -> Any:
    """Compile an expression."""
    return compile(ast.Expression(expression), "<traced>", "eval")


def _may_leave(statements: Sequence[ast.stmt]) -> bool:
    """Return whether statements may return, or leave their loop."""
    return any(
        isinstance(node, ast.Return | ast.Break | ast.Continue)
        for one in statements
        for node in ast.walk(one)
    )


def _lists(values: Any) -> Iterator[list[Any]]:
    """Yield the lists among values, including nested ones, each once."""
    waiting, seen = list(values), set[int]()
    while waiting:
        value = waiting.pop()
        if isinstance(value, list) and id(value) not in seen:
            seen.add(id(value))
            yield value
            waiting += [one for one in value if isinstance(one, list)]


class _TracerCalls(ast.NodeTransformer):
    """Transformer of calls, `if` expressions, `and`, `or` and `not` to calls of the tracer."""

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        return ast.Call(ast.Name("_call", ast.Load()), [node.func, *node.args], node.keywords)

    def visit_IfExp(self, node: ast.IfExp) -> ast.AST:
        self.generic_visit(node)
        return _tracer_call("_select", node.test, _deferred(node.body), _deferred(node.orelse))

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.AST:
        self.generic_visit(node)
        turned = isinstance(node.op, ast.Or)  # a or b is not (not a and not b)
        values = [_tracer_call("_not", one) if turned else one for one in node.values]
        whole = values[0]
        for one in values[1:]:
            whole = _tracer_call("_both", whole, _deferred(one))
        return _tracer_call("_not", whole) if turned else whole

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.AST:
        self.generic_visit(node)
        return _tracer_call("_not", node.operand) if isinstance(node.op, ast.Not) else node


def _tracer_call(name: str, *given: ast.expr) -> ast.expr:
    return ast.Call(ast.Name(name, ast.Load()), list(given), [])


def _deferred(value: ast.expr) -> ast.expr:
    """Return a lambda that computes a value on demand."""
    nothing = ast.arguments(posonlyargs=[], args=[], kwonlyargs=[], kw_defaults=[], defaults=[])
    return ast.Lambda(nothing, value)
