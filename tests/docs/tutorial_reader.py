"""Tutorials as a reader meets them: the blocks of a page, and a working folder where they are run one after the other.

Blocks: `sh` (commands), `python` (one program for the whole page), `text` (what the block before prints) and any with
`title="FILE"`, which the reader writes into a file. Comments before a block, which a page does not show:

- `<!-- test: WORDS -->`: a test adds these words to the block's spgf commands, since what a reader runs takes too long;
  `status=2` among them says that the command ends so;
- `<!-- not run: REASON -->`: no test can run it.

In a test, the port 8786 of a page is one that is free.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import socket
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from typing import Any

from commands import not_imported, process_kept

from spgf_torch.__main__ import main

FENCE = re.compile(
    r"(?:^<!-- (?P<mark>test|not run): (?P<words>[^\n]*?) -->\n)?"
    r"^(?P<fence>```+)(?P<info>[^\n]*)\n(?P<text>.*?)^(?P=fence)$",
    re.DOTALL | re.MULTILINE,
)
TITLE = re.compile(r'title="([^"]+)"')
# What the progress of a stage says on stderr: seconds, and nothing that a page shows.
PROGRESS = re.compile(r" \d+ \w* +done in +[\d.]+ s| \d+ of \d+ \w+ +[\d.]+ s, about")
RUN = ("sh", "python")
PORT = "8786"


@dataclass(frozen=True)
class Block:
    """A block of a page: its line, its language, the file that it is, what a test adds, why it cannot be run."""

    line: int
    language: str
    text: str
    file: str | None = None
    added: tuple[str, ...] = ()
    not_run: str | None = None

    @property
    def shows(self) -> bool:
        """Whether it is what the block before prints."""
        return self.language == "text"


def blocks(page: Path) -> list[Block]:
    """All blocks of a page, in order."""
    content = page.read_text(encoding="utf-8")
    return [block(content, found) for found in FENCE.finditer(content)]


def block(content: str, found: re.Match[str]) -> Block:
    line = content[: found.start("fence")].count("\n") + 1
    info, title = found["info"].strip(), TITLE.search(found["info"])
    reason = found["words"] if found["mark"] == "not run" else None
    added = tuple(shlex.split(found["words"])) if found["mark"] == "test" else ()
    return Block(line, info.split(" ")[0], found["text"], title[1] if title else None, added, reason)


def shown(expected: str, printed: str) -> bool:
    """Whether `printed` is what a page says: `...` is any part of a line, a line of it any lines; blanks are one."""
    pattern = "".join(
        r"(?:[^\n]*\n)*?" if line.strip() == "..." else re.escape(squeezed(line)).replace(r"\.\.\.", r"[^\n]*") + r"\n"
        for line in expected.splitlines()
        if line.strip()
    )
    lines = [squeezed(line) for line in printed.splitlines() if line.strip() and not PROGRESS.search(line)]
    return re.fullmatch(pattern, "".join(f"{line}\n" for line in lines)) is not None


def squeezed(line: str) -> str:
    return " ".join(line.split())


@dataclass
class Reader:
    """Runs blocks in the working folder of this process, which whoever makes it has changed to a new one."""

    names: dict[str, Any] = field(default_factory=lambda: {"__name__": "tutorial"})
    port: int = field(default_factory=lambda: free_port())

    def run(self, block: Block, place: str) -> str:
        """What a block prints, on stdout and stderr. AssertionError where a command ends with another status."""
        text = block.text.replace(PORT, str(self.port))
        if block.file is not None:
            Path(block.file).write_text(text, encoding="utf-8")
            return ""
        if block.language == "python":
            out = StringIO()
            with redirect_stdout(out), redirect_stderr(out):
                exec(compile("\n" * block.line + text, place, "exec"), self.names)
            return out.getvalue()
        return "".join(self.line(words, block.added) for words in command_lines(text))

    def close(self) -> None:
        """Close what the page's program has opened and not closed, such as a cluster, or a process."""
        for opened in self.names.values():
            if isinstance(opened, subprocess.Popen):
                opened.kill()  # else it would be waited for
            if isinstance(opened, AbstractContextManager):
                opened.__exit__(None, None, None)

    def line(self, words: Sequence[str], added: Sequence[str] = ()) -> str:
        """What one line of a shell prints: `spgf`, in this process, or one of a few commands of the system."""
        program, *rest = words
        if program == "spgf":
            return spgf([*rest, *added])
        return SYSTEM[program](*rest) or ""


def free_port() -> int:
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        return listening.getsockname()[1]


def command_lines(text: str) -> Iterator[list[str]]:
    """The words of each line of a shell."""
    for line in text.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        if words:
            yield words


def spgf(words: Sequence[str]) -> str:
    """What the command prints, run in this process, which it leaves as it was."""
    expected = next((int(word.removeprefix("status=")) for word in words if word.startswith("status=")), 0)
    arguments, status, out = [word for word in words if not word.startswith("status=")], 0, StringIO()
    module = f"spgf_torch.{arguments[0]}"
    with process_kept(), not_imported(module), redirect_stdout(out), redirect_stderr(out):
        try:
            status = main(arguments)
        except SystemExit as left:
            status = left.code if isinstance(left.code, int) else 0
    assert status == expected, f"spgf {shlex.join(arguments)}: status {status}\n{out.getvalue()}"
    return out.getvalue()


def listed(*folders: str) -> str:
    """The names in a folder, one a line."""
    names = sorted(path.name for path in Path(*folders).iterdir())
    return "".join(f"{name}\n" for name in names if not name.startswith("."))


def made(*folders: str) -> None:
    for folder in folders:
        Path(folder).mkdir(parents=True, exist_ok="-p" in folders) if folder != "-p" else None


def copied(*files: str) -> None:
    for file in files[:-1]:
        shutil.copy(file, files[-1])


# What a page may ask of a shell, other than spgf.
SYSTEM = {
    "cat": lambda *files: "".join(Path(file).read_text(encoding="utf-8") for file in files),
    "cd": os.chdir,
    "cp": copied,
    "ls": listed,
    "mkdir": made,
}
