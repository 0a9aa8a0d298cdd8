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


def faults(node: ast.AST, compiled: bool) -> Iterator[tuple[ast.AST, str, ast.AST | str]]:
    """Yield the node, the kind and the replacement of each fault that can be planted at a node."""
    match node:
        case ast.Compare(left, ops, comparators):
            for k, sign in enumerate(ops):
                if other := COMPARED.get(type(sign)):
                    changed = [*ops[:k], other(), *ops[k + 1 :]]
                    yield node, "comparison", ast.Compare(left, changed, comparators)
        case ast.BinOp(left, op, right) if type(op) in COMPUTED:
            if not any(map(_is_text, (left, right))):
                yield node, "arithmetic", ast.BinOp(left, COMPUTED[type(op)](), right)
        case ast.AugAssign(target, op, value) if type(op) in COMPUTED:
            after = ast.AugAssign(target, COMPUTED[type(op)](), value)
            yield node, "arithmetic", ast.unparse(after)
        case ast.Constant(bool(value)):
            yield node, "constant", repr(not value)
        case ast.Constant(int(value)):
            yield node, "constant", repr(value + 1)
        case ast.Constant(float(value)):
            yield node, "constant", repr(2.0 * value if value else 1.0)
        case ast.UnaryOp(ast.Not() | ast.USub() | ast.Invert(), operand):
            yield node, "negation", operand
        case ast.BoolOp(op, values):
            yield node, "and / or", ast.BoolOp(ast.Or() if isinstance(op, ast.And) else ast.And(),
                                               values)  # fmt: skip
        case ast.Call(function, args, keywords):
            called = _called(node)
            if called in OPPOSITE:
                named, other_name = isinstance(function, ast.Name), OPPOSITE[called]
                by_name: ast.expr = ast.Name(other_name)
                yield (
                    function,
                    "min / max",
                    (by_name if named else ast.Attribute(function.value, other_name)),
                )
            if len(args) > 1 and not any(isinstance(arg, ast.Starred) for arg in args[:2]):
                same = ast.dump(args[0]) == ast.dump(args[1])
                if not same and called not in {"isinstance", "getattr", "hasattr"}:
                    swapped = ast.Call(function, [args[1], args[0], *args[2:]], keywords)
                    yield node, "order of arguments", swapped
        case ast.Return(ast.expr() as value):
            if not compiled and not isinstance(value, ast.Constant):
                yield value, "returned value", "None"


def _is_text(side: ast.AST) -> bool:
    """Return whether an operand is text."""
    number = isinstance(getattr(side, "value", ""), int | float)
    return isinstance(side, ast.JoinedStr | ast.Constant) and not number


def _called(node: ast.Call) -> str:
    """Return the name of the function that is called."""
    name = node.func
    return name.id if isinstance(name, ast.Name) else getattr(name, "attr", "")


def parts(node: ast.AST) -> list[ast.AST]:
    """Return the parts of a node in which faults are planted."""
    match node:
        case ast.FunctionDef(args=args, body=body):
            defaults = [one for one in (*args.defaults, *args.kw_defaults) if one is not None]
            return [*defaults, *body]
        case ast.ClassDef(body=body):
            return list(body)
        case ast.Raise() | ast.Assert() | ast.JoinedStr() | ast.Import() | ast.ImportFrom():
            return []
        case ast.Expr(ast.Constant()) | ast.If(ast.Name("TYPE_CHECKING")):
            return []
        case ast.Assign(targets=[ast.Name("__all__")]):
            return []
        case ast.Call() if _called(node) in {"NewType", "TypeVar", "ParamSpec"}:
            return []
        case ast.Assign() | ast.AnnAssign() | ast.AugAssign() | ast.Return():
            return [] if node.value is None else [node.value]
    return list(ast.iter_child_nodes(node))


def sites(
    node: ast.AST, names: tuple[str, ...] = (), compiled: bool = False
) -> Iterator[tuple[ast.AST, str, ast.AST | str, str, bool]]:
    """Yield the faults below a node, with the function around them and whether it is compiled."""
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        names = (*names, node.name)
        marks = {mark.id for mark in node.decorator_list if isinstance(mark, ast.Name)}
        compiled = compiled or (isinstance(node, ast.FunctionDef) and bool(marks & MARKS))
    for found in faults(node, compiled):
        yield *found, ".".join(names), compiled
    for part in parts(node):
        yield from sites(part, names, compiled)


def mutants_of(root: Path, path: str) -> Iterator[Mutant]:
    """Yield the faults that can be planted in one file."""
    source = (root / path).read_bytes()
    lines = [0]
    for line in source.splitlines(keepends=True):
        lines.append(lines[-1] + len(line))
    seen = dict[tuple[str, str, str], int]()
    for node, operator, after, function, compiled in sites(ast.parse(source)):
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
