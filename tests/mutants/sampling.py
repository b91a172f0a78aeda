"""Mutants to try: operators of Cosmic Ray, a place of the program each, drawn by package."""

from __future__ import annotations

import ast
import difflib
import random
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
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

# Without `@compiled` or `@lean` a kernel does the same, slowly; variables are only replaced by name; of exceptions with
# a dot in their name Cosmic Ray makes nothing.
LEFT_OUT = ("RemoveDecorator", "VariableInserter", "VariableReplacer", "ExceptionReplacer")


# The ranges of settings, which a test could only repeat; what needs Open3D, which `make test` does without.
NOT_CHANGED = ("config.py", "fpfh.py")


@dataclass(frozen=True)
class Mutant:
    """One changed place, in `line` of the module `path`, relative to the repository; its text before and after."""

    path: Path
    line: int
    operator: str
    before: str
    after: str

    def diff(self) -> str:
        """What is changed, as `diff -u` shows it."""
        before, after = self.before.splitlines(), self.after.splitlines()
        lines = difflib.unified_diff(before, after, str(self.path), str(self.path), lineterm="", n=1)
        return "\n".join(line.rstrip() for line in lines)


@dataclass(frozen=True)
class Change:
    """The `occurrence` of what an operator changes in a module."""

    path: Path
    line: int
    operator: str
    occurrence: int

    def mutants(self, root: Path) -> Iterator[Mutant]:
        """The mutant; none where nothing that runs is changed, or it cannot be parsed."""
        before = (root / self.path).read_text(encoding="utf-8")
        after = mutate_code(before, get_operator(self.operator)(), self.occurrence)
        with suppress(SyntaxError):
            if after is not None and _runs(before) != _runs(after):
                yield Mutant(self.path, self.line, self.operator, before, after)


def draw(root: Path, packages: list[str], count: int, seed: int) -> list[Mutant]:
    """`count` mutants, as many of each package, no two at one place; all places of a package are as likely."""
    drawn = []
    for i, package in enumerate(packages):
        chance = random.Random(f"{seed}/{package}")
        places = list(_places(root, package).values())
        chance.shuffle(places)
        share = (count + len(packages) - 1 - i) // len(packages)
        mutants = (mutant for place in places for mutant in chance.choice(place).mutants(root))
        drawn += list(islice(mutants, share))
    return drawn


def _places(root: Path, package: str) -> dict[tuple[Path, tuple[int, int]], list[Change]]:
    """Every place of a package that an operator changes, with what they change."""
    operators = {name: get_operator(name)() for name in operator_names() if _wanted(name.split("/")[1])}
    places: dict[tuple[Path, tuple[int, int]], list[Change]] = {}
    for path in sorted((root / "spgf_torch" / package).rglob("*.py")):
        if path.name in NOT_CHANGED:
            continue
        short = path.relative_to(root)
        for start, name, occurrence in _positions(path.read_text(encoding="utf-8"), operators):
            places.setdefault((short, start), []).append(Change(short, start[0], name, occurrence))
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
