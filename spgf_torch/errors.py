"""What goes wrong because of what was given, or before the end: one line each."""

from __future__ import annotations

# Characters of a line that says what is wrong.
LONGEST_LINE = 1000


class InputError(ValueError):
    """Something the user gave cannot be used: one line that names it, what was expected and what was got.

    Names and values in it may come from a file: what would break the line or steer a terminal is written as `\\x1b`.
    """

    def __init__(self, message: str) -> None:
        super().__init__(one_line(message))


def one_line(words: str) -> str:
    """`words` without line breaks and control characters; of more than `LONGEST_LINE` characters both ends."""
    line = " ".join(words.split()) if not words.isprintable() else words
    line = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in line)
    half = LONGEST_LINE // 2 - 3
    return line if len(line) <= LONGEST_LINE else f"{line[:half]} ... {line[-half:]}"


class IncompleteError(Exception):
    """Work that could not be done to its end, in one line as for `InputError`; what is finished is kept (status 1)."""

    def __init__(self, message: str) -> None:
        super().__init__(one_line(message))
