"""A proposed description as YAML with a comment beside each key; `# ?` begins what the URDF does not tell."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import yaml

from spgf_torch.handcheck.proposal import Proposal
from spgf_torch.hands.config import HandConfig

MARK = "#"  # of a comment in YAML
HEAD = (
    f"{MARK} Proposed by python -m spgf_torch.hand from the URDF alone; look at the picture.",
    f"{MARK} Lines with `{MARK} ?` say what the URDF does not tell. Keys: docs/howto/hand.md.",
)

WIDTH = 120  # characters of a line
# Keys of a preshape in their order, with what stands beside them.
TOLD = {
    "hold": "deg, m; joints that stand still",
    "opening": "m between the pads",
    "open": "deg, m",
    "close": "direction times share of the effort",
    "oppose": "groups that press against each other",
    "pads": "m, in the frame of each finger's first link",
}


def proposal_text(proposal: Proposal) -> str:
    """The file's content."""
    return "\n".join([*HEAD, *_lines(proposal), ""])


def _lines(proposal: Proposal) -> Iterator[str]:
    config, doubts = proposal.config, proposal.doubts
    yield f"name: {_flow(config.name)}"
    yield f"urdf: {_flow(config.urdf)}"
    yield from _doubts(doubts, "urdf")
    if config.packages:
        yield f"packages: {_flow(config.packages)}"
    if config.root is not None:
        yield f"root: {_flow(config.root)}"
    yield f"approach: {_flow(config.approach)}  {MARK} out of the palm, in the frame of root"
    yield from _doubts(doubts, "approach")
    yield f"fingers:  {MARK} links that count as touching; the first carries the pad"
    for name, links in config.fingers.items():
        yield f"  {_flow(name)}: {_flow(links)}"
    yield from _doubts(doubts, "fingers", "  ")
    yield "preshapes:"
    yield from _preshapes(proposal)
    yield from _closing(config)
    yield from _doubts(doubts, "closing", "  ")
    if proposal.error:
        yield f"{MARK} ? this does not load yet: {proposal.error}"


def _preshapes(proposal: Proposal) -> Iterator[str]:
    """The first one in full; of the others what differs from it."""
    first = ""
    common: dict[str, Any] = {}
    for name, preshape in proposal.config.preshapes.items():
        values = {key: value for key in TOLD if (value := getattr(preshape, key)) not in (None, {}, [])}
        yield f"  {_flow(name)}:" + ("" if first else " &first")
        if first:
            yield "    <<: *first"
        for key, value in values.items():
            if common.get(key) != value:
                yield from _entry(key, value, TOLD[key], "    ")
                yield from _doubts(proposal.doubts, key, "    ")
        first, common = first or name, common or values


def _entry(key: str, value: Any, words: str, indent: str) -> Iterator[str]:
    """A key on one line where there is room, else an entry a line."""
    line = f"{indent}{key}: {_flow(value)}  {MARK} {words}"
    if len(line) <= WIDTH or not isinstance(value, dict):
        yield line
        return
    yield f"{indent}{key}:  {MARK} {words}"
    yield from (f"{indent}  {_flow(name)}: {_flow(part)}" for name, part in value.items())


def _closing(config: HandConfig) -> Iterator[str]:
    told = {"effort": "Nm, or N of joints that slide", "speed": "rad/s or m/s of the targets", "time": "s at most"}
    values = {key: getattr(config.closing, key) for key in told}
    if any(value is not None for value in values.values()):
        yield f"closing:  {MARK} from the URDF's efforts and velocities, 50 N at a pad and 0.8 s for the stroke at most"
        for key, value in values.items():
            yield f"  {key}: {_flow(value)}  {MARK} {told[key]}"


def _doubts(doubts: dict[str, list[str]], key: str, indent: str = "") -> Iterator[str]:
    yield from (f"{indent}{MARK} ? {words}" for words in doubts.get(key, []))


def _flow(value: Any) -> str:
    """A value of YAML on one line."""
    text = yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=float("inf"), allow_unicode=True)
    return text.removesuffix("\n").removesuffix("\n...").strip()
