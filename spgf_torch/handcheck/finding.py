"""What a check of a hand found."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from spgf_torch.errors import InputError

HEAD = ("check", "preshape", "measured", "expected", "")


@dataclass(frozen=True)
class Finding:
    """One check of one preshape, or of the hand as a whole.

    Attributes:
        check: its name. preshape: the grasp type; empty of the hand as a whole.
        measured: what was found, with its unit. expected: the bound. ok: whether it is kept.
        remedy: what is probably wrong where it is not, as a sentence without its full stop.
    """

    check: str
    preshape: str
    measured: str
    expected: str
    ok: bool
    remedy: str

    def line(self) -> str:
        """For an error: check and preshape, what was expected, what was got, what to look at."""
        of = f" of {self.preshape}" if self.preshape else ""
        return f"{self.check}{of}: expected {self.expected}, got {self.measured}; {self.remedy}"


def failed(findings: Iterable[Finding]) -> list[Finding]:
    """Those that are not kept."""
    return [finding for finding in findings if not finding.ok]


def refuse(name: str, findings: Sequence[Finding], where: str = "python -m spgf_torch.hand shows all") -> None:
    """InputError with the first check that is not kept, in one line, how many more there are, and where they stand."""
    wrong = failed(findings)
    if wrong:
        more = f"; {len(wrong) - 1} more, {where}" if len(wrong) > 1 else ""
        raise InputError(f"hand {name}: {wrong[0].line()}{more}")


def table(findings: Sequence[Finding]) -> str:
    """All of them as aligned text, a row each; what fails has its remedy in a line below."""
    rows = [HEAD, *((f.check, f.preshape, f.measured, f.expected, "ok" if f.ok else "FAILS") for f in findings)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(HEAD))]
    lines = ["  ".join(f"{cell:{width}}" for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    for at, finding in reversed(list(enumerate(findings, start=1))):
        if not finding.ok:
            lines.insert(at + 1, f"  ^ {finding.remedy}")
    return "\n".join(lines)
