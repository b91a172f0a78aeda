"""The statements of a source: functions and imports are among them, and expressions are most of what a tree holds."""

import ast
from collections.abc import Iterator


def statements(node: ast.AST) -> Iterator[ast.AST]:
    """All below a node, at any depth, and the branches of `try` and `match`."""
    for kind in ("body", "orelse", "handlers", "finalbody", "cases"):
        for child in getattr(node, kind, ()):
            yield child
            yield from statements(child)
