"""docs/tutorials: each page's blocks run in order, as a reader does, and print what the page shows."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from commands import ROOT
from tutorial_reader import RUN, SYSTEM, Block, Reader, blocks, command_lines, shown

PAGES = sorted((ROOT / "docs/tutorials").glob("*.md"))
# How many blocks of a page no test can run, each with its reason on the page.
NOT_RUN = {"first_grasp": 1, "cluster": 2, "server": 2}
# Pages of which a run trains or clears, 40 s of a processor each, or starts a server, as tests/serving do:
# `make tutorials` runs them, the suite composes their commands (tests/test_docs.py).
LONG = ("clutter", "own_hand", "own_objects", "server")
# What an extra brings, without which a page is of no use.
EXTRAS = {"cluster": "distributed", "server": "uvicorn"}


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    before = Path.cwd()
    os.chdir(tmp_path)
    yield tmp_path
    os.chdir(before)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
@pytest.mark.filterwarnings("ignore::UserWarning")  # a scene's notes
def test_a_tutorial_does_what_it_says(page: Path, folder: Path) -> None:
    if page.stem in LONG and os.environ.get("SPGF_TUTORIALS") != "all":
        pytest.skip("trains, clears or serves: make tutorials")
    if page.stem in EXTRAS:
        pytest.importorskip(EXTRAS[page.stem])
    reader = Reader()
    try:
        follow(reader, page)
    finally:
        reader.close()


def follow(reader: Reader, page: Path) -> None:
    printed: str | None = ""
    for block in blocks(page):
        place = f"{page.relative_to(ROOT)}:{block.line}"
        if block.shows and printed is not None and not shown(block.text, printed):
            pytest.fail(f"{place}: expected\n{block.text}\ngot\n{printed}", pytrace=False)
        if not block.shows:
            printed = None if block.not_run else reader.run(block, place)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_block_is_run_or_says_why_not(page: Path) -> None:
    """And a block that shows what is printed follows one that prints."""
    found = blocks(page)
    assert sum(block.not_run is not None for block in found) == NOT_RUN.get(page.stem, 0)
    assert page.read_text(encoding="utf-8").count("```") == 2 * len(found)
    before: Block | None = None
    for block in found:
        place = f"{page.name}:{block.line}"
        assert block.language in RUN or block.shows or block.file, f"{place}: {block.language} is not run"
        assert not block.shows or (before and before.language in RUN), f"{place}: shows what nothing prints"
        for words in command_lines(block.text) if block.language == "sh" and not block.not_run else ():
            assert words[0] == "spgf" or words[0] in SYSTEM, f"{place}: {words[0]} is not run"
        before = block


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_tutorial_is_short_and_begins_with_its_end(page: Path) -> None:
    lines = page.read_text(encoding="utf-8").splitlines()
    assert 40 <= len(lines) <= 120 and lines[2].startswith("At the end you have "), len(lines)


@pytest.mark.parametrize(
    ("expected", "printed", "same"),
    [
        ("a  b\n", "a b\n\n", True),
        ("a b\n", "a c\n", False),
        ("a\n", "a\nb\n", False),
        ("b\n", "a\nb\n", False),
        ("a\n...\n", "a\nb\nc\n", True),
        ("...\nc\n", "a\nb\nc\n", True),
        ("a\n...\nc\n", "a\nb\nd\n", False),
        ("20 grasps in ... s\n", "20 grasps in 1.25 s\n", True),
        ("20 grasps in ... s\n", "21 grasps in 1.25 s\n", False),
        ("a\n", "model             1 model      done in   96.3 s\na\n", True),
        ("a\n", "objects           1 of 4 meshes       29.0 s, about 87 s left\na\n", True),
        ("a\n", "20 grasps from 364 texlets in 7.40 s\na\n", False),
    ],
)
def test_what_counts_as_shown(expected: str, printed: str, same: bool) -> None:
    assert shown(expected, printed) == same
