"""Mutants to try: operators of Cosmic Ray, a place of the program each, drawn by room."""

from __future__ import annotations

import ast
import difflib
import random
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.operator import Operator
from cosmic_ray.plugins import get_operator, operator_names

# One for another within a family: a shift or an "is" between two float tensors is a TypeError that any test sees.
FAMILIES = (
    {"Add", "Sub", "Mul", "Div", "FloorDiv", "Mod", "Pow"},
    {"LShift", "RShift"},
    {"BitOr", "BitAnd", "BitXor"},
    {"Eq", "NotEq", "Lt", "LtE", "Gt", "GtE"},
    {"Is", "IsNot"},
)

# Without `@compiled` a kernel does the same, slowly; variables are only replaced by name; of exceptions with a dot in
# their name Cosmic Ray makes nothing.
LEFT_OUT = ("RemoveDecorator", "VariableInserter", "VariableReplacer", "ExceptionReplacer")


@dataclass(frozen=True)
class Mutant:
    """One changed place: `occurrence` of what `operator` changes in the module `path`, relative to the repository."""

    path: Path
    line: int
    operator: str
    occurrence: int

    def source(self, root: Path) -> str | None:
        """The changed module; None where nothing that runs is changed, or it cannot be parsed."""
        before = (root / self.path).read_text(encoding="utf-8")
        after = mutate_code(before, get_operator(self.operator)(), self.occurrence)
        try:
            return None if after is None or _runs(before) == _runs(after) else after
        except SyntaxError:
            return None

    def diff(self, root: Path) -> str:
        """What is changed, as `diff -u` shows it."""
        before, after = (root / self.path).read_text(encoding="utf-8"), self.source(root) or ""
        lines = difflib.unified_diff(before.splitlines(), after.splitlines(), str(self.path), str(self.path), "", "", 1)
        return "\n".join(line.rstrip() for line in lines)


def draw(root: Path, rooms: list[str], count: int, seed: int) -> list[Mutant]:
    """`count` mutants, as many of each room, no two at one place; every place of a room is as likely as another."""
    drawn = []
    for i, room in enumerate(rooms):
        chance = random.Random(f"{seed}/{room}")
        places = list(_places(root, room).values())
        chance.shuffle(places)
        share = (count + len(rooms) - 1 - i) // len(rooms)
        candidates = (chance.choice(place) for place in places)
        changed = (mutant for mutant in candidates if mutant.source(root) is not None)
        drawn += [mutant for mutant, _ in zip(changed, range(share), strict=False)]
    return drawn


def _places(root: Path, room: str) -> dict[tuple[Path, tuple[int, int]], list[Mutant]]:
    """Every place of a room that an operator changes, with its mutants."""
    operators = {name: get_operator(name)() for name in operator_names() if _wanted(name.split("/")[1])}
    places: dict[tuple[Path, tuple[int, int]], list[Mutant]] = {}
    for path in sorted((root / "spgf_torch" / room).rglob("*.py")):
        short = path.relative_to(root)
        for start, name, occurrence in _positions(path.read_text(encoding="utf-8"), operators):
            places.setdefault((short, start), []).append(Mutant(short, start[0], name, occurrence))
    return places


def _positions(source: str, operators: dict[str, Operator]) -> Iterator[tuple[tuple[int, int], str, int]]:
    """Start, operator and its occurrence, counted as Cosmic Ray's own walk does."""
    seen = dict.fromkeys(operators, 0)
    for node in ast_nodes(get_ast(source)):
        for name, operator in operators.items():
            for start, _ in operator.mutation_positions(node):
                yield start, name, seen[name]
                seen[name] += 1


def _wanted(operator: str) -> bool:
    if operator.startswith(LEFT_OUT):
        return False
    _, *terms = operator.split("_")
    related = any(set(terms) <= family for family in FAMILIES)
    return related or not operator.startswith(("ReplaceBinaryOperator", "ReplaceComparisonOperator"))


class _WithoutTypes(ast.NodeTransformer):
    """Drops what `from __future__ import annotations` never evaluates."""

    def visit_arg(self, node: ast.arg) -> ast.arg:
        node.annotation = None
        return node

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.FunctionDef:
        node.returns = None
        self.generic_visit(node)
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AnnAssign:
        node.annotation = ast.Constant(None)
        self.generic_visit(node)
        return node


def _runs(source: str) -> str:
    return ast.dump(_WithoutTypes().visit(ast.parse(source)))
