"""Every function fits on a screen and takes few enough arguments to be called without looking."""

import ast
from collections.abc import Iterator

import pytest
from commands import ROOT
from statements import statements

MOST_ARGUMENTS, MOST_LINES = 8, 50


def offenders(source: str, place: str = "") -> Iterator[str]:
    """Each function that is too long or takes too much; self and cls do not count."""
    for node in statements(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            known = node.args
            named = [argument.arg for argument in (*known.posonlyargs, *known.args, *known.kwonlyargs)]
            arguments = len([*named, *filter(None, (known.vararg, known.kwarg))]) - (named[:1] in (["self"], ["cls"]))
            lines = (node.end_lineno or 0) - node.lineno + 1
            if arguments > MOST_ARGUMENTS or lines > MOST_LINES:
                yield f"{place}:{node.lineno}: {node.name}: {arguments} arguments, {lines} lines"


def test_functions_are_small() -> None:
    found = []
    for room in ("spgf_torch", "tests"):
        for path in sorted((ROOT / room).rglob("*.py")):
            found += offenders(path.read_text(encoding="utf-8"), str(path.relative_to(ROOT)))
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("source", "count"),
    [
        ("def f(a, b, c, d, e, f, g, h): pass", 0),
        ("def f(a, b, c, d, e, f, g, h, i): pass", 1),
        ("def f(a, /, b, c, d, e, f, g, *h, i): pass", 1),
        ("async def f(a, b, c, d, e, f, g, h, **i): pass", 1),
        ("class A:\n def f(self, a, b, c, d, e, f, g, h): pass", 0),
        ("class A:\n def f(self, a, b, c, d, e, f, g, h, i): pass", 1),
        ("def f():\n" + " pass\n" * 49, 0),
        ("def f():\n" + " pass\n" * 50, 1),
        ("def f():\n def g(a, b, c, d, e, f, g, h, i): pass", 1),
        ("try: pass\nexcept E:\n def g(a, b, c, d, e, f, g, h, i): pass", 1),
        ("match a:\n case 1:\n  def g(a, b, c, d, e, f, g, h, i): pass", 1),
    ],
)
def test_what_is_too_much(source: str, count: int) -> None:
    assert len(list(offenders(source))) == count
