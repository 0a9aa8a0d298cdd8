"""Mutants of Python sources for mutation testing: where faults can be planted, and their text.

The operators are those of mutmut and Cosmic Ray: boundaries of comparisons, arithmetic, constants,
negations, min and max, order of arguments, missing return values, and/or. Docstrings, annotations,
decorators, error texts and assertions are left alone.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

COMPARED = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip

COMPUTED = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult,
    ast.FloorDiv: ast.Mult, ast.Mod: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
    ast.LShift: ast.RShift, ast.RShift: ast.LShift,
}  # fmt: skip

OPPOSITE = {
    "min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "any": "all",
    "argmin": "argmax", "argmax": "argmin", "all": "any", "floor": "ceil", "ceil": "floor",
}  # fmt: skip

MARKS = {"kernel", "part", "entry"}
"""Decorators of compiled functions."""


class Mutant(NamedTuple):
    """A fault at one place of a source file."""

    path: str
    """Source file, relative to the repository."""
    function: str
    """Qualified name of the enclosing function or class, or empty."""
    operator: str
    line: int
    start: int
    stop: int
    """Bytes from `start` to `stop` of the source are replaced: `before` by `after`."""
    before: str
    after: str
    compiled: bool
    """Whether the fault lies in a kernel."""
    number: int
    """Number of equal faults before it in the same function."""

    @property
    def key(self) -> str:
        """Identifier of the fault, which changes elsewhere in the file do not affect."""
        where = f"{self.path} {self.function or '-'}"
        return f"{where}: {self.before} => {self.after} #{self.number}"

    def rank(self, seed: int) -> str:
        """Return the position of the fault in a random order."""
        return hashlib.sha256(f"{seed} {self.key}".encode()).hexdigest()


class _Sites(ast.NodeVisitor):
    """Visitor that collects the faults of one file."""

    def __init__(self) -> None:
        self.found: list[tuple[ast.AST, str, ast.AST | str, str, bool]] = []
        self.names: list[str] = []
        self.compiled = False

    def add(self, node: ast.AST, operator: str, after: ast.AST | str) -> None:
        self.found.append((node, operator, after, ".".join(self.names), self.compiled))

    def scope(self, node: ast.FunctionDef | ast.ClassDef) -> None:
        """Visit a body without docstring, annotations and decorators, but with default values."""
        self.names.append(node.name)
        before = self.compiled
        if isinstance(node, ast.FunctionDef):
            marks = {mark.id for mark in node.decorator_list if isinstance(mark, ast.Name)}
            self.compiled = before or bool(marks & MARKS)
            for default in (*node.args.defaults, *node.args.kw_defaults):
                if default is not None:
                    self.visit(default)
        for inner in node.body:
            self.visit(inner)
        self.names.pop()
        self.compiled = before

    visit_FunctionDef = visit_ClassDef = scope

    def leave(self, node: ast.AST) -> None:
        """Leave a node unchanged."""

    visit_Raise = visit_Assert = visit_JoinedStr = visit_Import = visit_ImportFrom = leave

    def visit_Expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):
            self.generic_visit(node)

    def visit_If(self, node: ast.If) -> None:
        if ast.unparse(node.test) != "TYPE_CHECKING":
            self.generic_visit(node)

    def visit_Assign(self, node: ast.Assign) -> None:
        if not any(isinstance(t, ast.Name) and t.id == "__all__" for t in node.targets):
            self.visit(node.value)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_Compare(self, node: ast.Compare) -> None:
        for k, sign in enumerate(node.ops):
            other = COMPARED.get(type(sign))
            if other is not None:
                ops = [other() if i == k else op for i, op in enumerate(node.ops)]
                self.add(node, "comparison", ast.Compare(node.left, ops, node.comparators))
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        other = COMPUTED.get(type(node.op))
        texts = (ast.JoinedStr, ast.Constant)
        text = any(
            isinstance(side, texts) and not isinstance(getattr(side, "value", ""), int | float)
            for side in (node.left, node.right)
        )
        if other is not None and not text:
            self.add(node, "arithmetic", ast.BinOp(node.left, other(), node.right))
        self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        other = COMPUTED.get(type(node.op))
        if other is not None:
            after = f"{ast.unparse(node.target)} {_sign(other())}= {ast.unparse(node.value)}"
            self.add(node, "arithmetic", after)
        self.visit(node.value)

    def visit_Constant(self, node: ast.Constant) -> None:
        value = node.value
        if isinstance(value, bool):
            self.add(node, "constant", repr(not value))
        elif isinstance(value, int):
            self.add(node, "constant", repr(value + 1))
        elif isinstance(value, float):
            self.add(node, "constant", repr(2.0 * value if value else 1.0))

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        if isinstance(node.op, ast.Not | ast.USub | ast.Invert):
            self.add(node, "negation", node.operand)
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        other = ast.Or() if isinstance(node.op, ast.And) else ast.And()
        self.add(node, "and / or", ast.BoolOp(other, node.values))
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        name = node.func
        called = name.id if isinstance(name, ast.Name) else getattr(name, "attr", "")
        if called in OPPOSITE:
            other: ast.expr = ast.Name(OPPOSITE[called])
            if isinstance(name, ast.Attribute):
                other = ast.Attribute(name.value, OPPOSITE[called])
            self.add(name, "min / max", other)
        two = node.args[:2]
        starred = any(isinstance(arg, ast.Starred) for arg in two)
        if len(two) == 2 and not starred and ast.dump(two[0]) != ast.dump(two[1]):
            swapped = ast.Call(node.func, [two[1], two[0], *node.args[2:]], node.keywords)
            if called not in {"isinstance", "getattr", "hasattr"}:
                self.add(node, "order of arguments", swapped)
        if called not in {"NewType", "TypeVar", "ParamSpec"}:
            self.generic_visit(node)

    def visit_Return(self, node: ast.Return) -> None:
        if node.value is None:
            return
        if not self.compiled and not isinstance(node.value, ast.Constant):
            self.add(node.value, "returned value", "None")
        self.visit(node.value)


def _sign(operator: ast.operator) -> str:
    return ast.unparse(ast.BinOp(ast.Name("a"), operator, ast.Name("b")))[2:-2]


def mutants_of(root: Path, path: str) -> Iterator[Mutant]:
    """Yield the faults that can be planted in one file."""
    source = (root / path).read_bytes()
    lines = [0]
    for line in source.splitlines(keepends=True):
        lines.append(lines[-1] + len(line))
    sites, seen = _Sites(), dict[tuple[str, str, str], int]()
    for node in ast.parse(source).body:
        sites.visit(node)
    for node, operator, after, function, compiled in sites.found:
        assert isinstance(node, ast.expr | ast.stmt)
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        start = lines[node.lineno - 1] + node.col_offset
        stop = lines[node.end_lineno - 1] + node.end_col_offset
        text = after if isinstance(after, str) else ast.unparse(after)
        if isinstance(after, ast.Compare | ast.BinOp | ast.BoolOp):
            text = f"({text})"
        before = " ".join(source[start:stop].decode().split())
        number = seen.get((function, before, text), 0)
        seen[function, before, text] = number + 1
        yield Mutant(
            path, function, operator, node.lineno, start, stop, before, text, compiled, number
        )


def planted(source: bytes, mutant: Mutant) -> bytes:
    """Return the source of a file with a fault planted; raise `SyntaxError` if it is no Python."""
    changed = source[: mutant.start] + mutant.after.encode() + source[mutant.stop :]
    compile(changed, mutant.path, "exec")
    return changed
