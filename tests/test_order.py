"""The order of the suite names files that are there, once each."""

from pathlib import Path

from longest import LONGEST


def test_what_begins_first_is_there() -> None:
    names = [path.name for path in Path(__file__).parent.rglob("test_*.py")]
    assert len(set(LONGEST)) == len(LONGEST) and not [name for name in LONGEST if names.count(name) != 1]
