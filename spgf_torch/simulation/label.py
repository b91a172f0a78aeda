"""How one trial ended and why, as one word between processes and on disk: `dropped/shake/none/2.31/finger_1_tip`.

Trials of an episode that knows no causes end in one of `table.OUTCOMES` alone, which is such a word, too. Imports
nothing, for workers.
"""

from __future__ import annotations

from dataclasses import dataclass

# When a trial ended; `none` where that is not known.
PHASES = ("none", "approach", "close", "lift", "turn", "shake", "held")
# What did it, beyond outcome and phase. Of a collision: the hand at the grasp cuts the object, or the table, or meets
# the object on its way. Of what is missed: nothing is touched, too few sides are, or a finger stands on the table.
CAUSES = ("none", "object", "table", "way", "nothing", "one_side")


@dataclass(frozen=True)
class Label:
    """The end of a trial.

    Attributes:
        outcome: one of `table.OUTCOMES`. phase: of `PHASES`. cause: of `CAUSES`.
        force: N with which the weakest of the opposing fingers that a grasp needs pressed on the object at the end.
        lost: links of the fingers that did not touch the object then, joined by +, or "".
    """

    outcome: str
    phase: str = "none"
    cause: str = "none"
    force: float = 0.0
    lost: str = ""

    @property
    def word(self) -> str:
        return f"{self.outcome}/{self.phase}/{self.cause}/{self.force:.4g}/{self.lost}"

    @property
    def told(self) -> str:
        """For people: outcome, what did it, or else when, and which fingers had let go."""
        what = self.cause if self.cause != "none" else self.phase
        parts = [what.replace("_", " ")] if what not in ("none", "held") else []
        if self.lost and self.outcome == "dropped":
            parts.append(f"without {self.lost.replace('+', ', ')}")
        return f"{self.outcome} ({', '.join(parts)})" if parts else self.outcome

    @staticmethod
    def of(word: str) -> Label:
        """The label of a word. Raises ValueError for a damaged one."""
        outcome, *more = word.split("/", 4)
        if not more:
            return Label(outcome)
        phase, cause, force, lost = more
        if phase not in PHASES or cause not in CAUSES:
            raise ValueError(f"no label: {word:.60}")
        return Label(outcome, phase, cause, float(force), lost)


def outcome_of(word: str) -> str:
    """One of `table.OUTCOMES`, of how a trial ended."""
    return word.partition("/")[0]
