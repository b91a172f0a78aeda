"""What comments, docstrings, reasons in conf/ and pages refer to is there, and what they quote was said."""

import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAPER = ROOT / "../shared/paper"
FOLDERS = ("spgf_torch", "conf", "docs", "tests", "data")

# A file of the repository: any page, and source or settings where the folder is said, too.
NAMED = re.compile(
    r"(?<![\w/.*{<-])((?:\.\./)*(?:[\w-]+/)*[\w-]+\.md|(?:[\w-]+/)+[\w-]+\.(?:py|yaml|urdf|toml))(?![\w*-])"
)
QUOTED = re.compile(r'(?<![=(])"([^"`=>{}_+[]+)"|“([^”]+)”')
DOCSTRING = re.compile(r'"""(.*?)"""', re.DOTALL)
FENCE = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)

# What commands leave, not the repository.
MADE = re.compile(
    r"(run/|set/|RUN/|FOLDER/)?(table1|table1_short|reach|ablations|comparison|judge|JUDGE|README)\.md|.*reference/commands/\w+\.md|index\.md"
    r"|.*[A-Z]{4}\.(yaml|urdf)"
)
# Of others: EGAD's script.
FOREIGN = {"scripts/prepare_meshes.py"}
# Quotation marks around what is nobody's sentence: titles of works and commits, and what the package itself writes.
TITLES = {
    "The PLY Polygon File Format",
    "The PCD (Point Cloud Data) file format",
    "Ellipsoids reach their full width",
    "In and out",
    "1 view, on a table",
    "on a table",
}


@cache
def texts() -> tuple[tuple[Path, str], ...]:
    """The comments and docstrings of each file of the repository, and its pages: running text, line breaks kept."""
    within = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*") if path != Path(__file__)]
    paths = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *within]
    return tuple((path, prose(path)) for path in paths if path.suffix in (".py", ".yaml", ".md"))


def prose(path: Path) -> str:
    """What a file of code, settings or text tells its readers."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".md":
        return FENCE.sub("", text)
    comments = re.sub(r"^(?:(?:[^#\n]|#(?! ))*\n|[^#\n]*# )", "", text, flags=re.MULTILINE)
    return comments + "\n".join(DOCSTRING.findall(text))


def missing(path: Path, text: str) -> list[str]:
    """Files that a text of `path` names, and that are neither beside it nor anywhere they could be."""
    bases = (path.parent, ROOT, ROOT / "spgf_torch", ROOT / "docs", ROOT / "tests")
    names = [name for name in NAMED.findall(text) if name not in FOREIGN and not MADE.fullmatch(name)]
    return [name for name in names if not any((base / name).exists() for base in bases)]


def unsaid(text: str, source: str) -> list[str]:
    """Quotations of three words or more that the `source` (`squashed`) does not contain."""
    quoted = [" ".join((a or b).split()) for a, b in QUOTED.findall(text)]
    return [q for q in quoted if len(q.split()) > 2 and q not in TITLES and squashed(q) not in source]


def squashed(text: str) -> str:
    """Letters and digits alone, since the text was extracted from two columns with words broken at their ends."""
    return re.sub(r"[\W_]", "", text.lower())


@cache
def paper() -> str:
    return squashed("".join(path.read_text(encoding="utf-8") for path in PAPER.glob("*.txt")))


def test_every_file_that_is_named_exists() -> None:
    found = [f"{path.relative_to(ROOT)}: {name}" for path, text in texts() for name in missing(path, text)]
    assert not found, found


def test_a_file_that_is_not_there_is_found() -> None:
    text = "Widths: FEATURES.md, docs/design/features.md and conf/nowhere.yaml; `report` leaves table1.md."
    assert missing(ROOT / "spgf_torch/errors.py", text) == ["FEATURES.md", "conf/nowhere.yaml"]


@pytest.mark.skipif(not PAPER.is_dir(), reason="the paper's text is not part of the repository")
def test_what_is_quoted_was_said() -> None:
    """In the package, conf/, data/ and docs/; tests quote what programs say."""
    told = [(str(path.relative_to(ROOT)), text) for path, text in texts()]
    found = [(name, quote) for name, text in told if not name.startswith("tests/") for quote in unsaid(text, paper())]
    assert not found, found


def test_a_quotation_that_nobody_said_is_found() -> None:
    said = squashed("the amount of simi-\nlar points (called support)")
    assert unsaid('It is "the amount of\nsimilar points", not "weight falling with distance".', said) == [
        "weight falling with distance"
    ]
