"""All that geometry tells of a hand before anything is simulated: a fraction of a second."""

from __future__ import annotations

from spgf_torch.handcheck.bodies import body_findings
from spgf_torch.handcheck.closed import closed_findings
from spgf_torch.handcheck.finding import Finding, refuse
from spgf_torch.handcheck.opened import opened_findings
from spgf_torch.handcheck.posed import Posed
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import Hand, load_hand

MOST_HANDS = 16  # whose findings are kept
_FINDINGS: dict[tuple[str, str], list[Finding]] = {}


def check_hand(hand: Hand) -> list[Finding]:
    """Every check of a hand and of each of its preshapes; once for a hand, however often it is asked for."""
    key = (hand.digest, str([joint.mimic for joint in hand.robot.joints]))
    if key not in _FINDINGS:
        if len(_FINDINGS) >= MOST_HANDS:
            _FINDINGS.pop(next(iter(_FINDINGS)))
        findings = list(body_findings(hand))
        for posed in Posed.all_of(hand):
            findings += [*opened_findings(posed), *closed_findings(posed)]
        _FINDINGS[key] = findings
    return _FINDINGS[key]


def checked_hand(config: HandConfig) -> Hand:
    """The hand of a description. Raises InputError, as `load_hand`, and for the first check that it does not pass."""
    hand = load_hand(config)
    refuse(hand.config.name, check_hand(hand))
    return hand
