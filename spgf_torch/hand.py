"""`python -m spgf_torch.hand hand=FILE`: check a hand's description and draw it, or propose one for a bare URDF.

Checks: by geometry, then by closing the hand in SAPIEN without an object (docs/howto/hand.md says what each means).
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from spgf_torch.cli.command import run_command
from spgf_torch.errors import InputError
from spgf_torch.extras import installed, remedy
from spgf_torch.files.run_settings import write_settings
from spgf_torch.handcheck.config import HandCheckConfig
from spgf_torch.hands.config import HandConfig
from spgf_torch.progress import ProgressReporter, show

if TYPE_CHECKING:
    from spgf_torch.handcheck.finding import Finding
    from spgf_torch.hands.hand import Hand

PICTURE, PAGE = "hand.png", "hand.html"


def run(config: HandCheckConfig, folder: Path) -> None:
    """Write pictures, and of a bare URDF a description, into `folder`, and show what the checks found.

    Raises InputError for a hand that cannot be loaded, and, once all is written, for the first check that fails.
    """
    from spgf_torch.handcheck.check import check_hand
    from spgf_torch.handcheck.finding import failed, refuse, table
    from spgf_torch.hands.hand import load_hand

    stages = ProgressReporter()
    if config.urdf is not None:
        config.hand = _proposed(config, config.urdf, folder, stages)
        write_settings(folder, config)
    with stages.stage("geometry", 1, "hands") as advance:
        hand = load_hand(config.hand)
        findings = check_hand(hand)
        advance(1)
    if config.simulate and not failed(findings):
        from spgf_torch.handcheck.standing import simulated_findings

        with stages.stage("closing", len(hand.preshapes), "preshapes") as advance:
            findings = [*findings, *simulated_findings(hand, config.episode, advance)]
    for note in hand.robot.notes:
        show(f"{hand.urdf}: {note}")
    _draw(hand, findings, folder, config.page and installed("plotly"))
    if config.page and not installed("plotly"):
        show(f"no page without {remedy('plotly')}")
    show(table(findings))
    show(f"{len(findings) - len(failed(findings))} of {len(findings)} checks passed; pictures in {folder}")
    refuse(hand.config.name, findings, "the table has all")


def _proposed(config: HandCheckConfig, urdf: str, folder: Path, stages: ProgressReporter) -> HandConfig:
    """Propose a description of a URDF, write it into the folder and show it. Raises InputError if it does not load."""
    from spgf_torch.files.writing import write_text
    from spgf_torch.handcheck.proposal import propose
    from spgf_torch.handcheck.proposal_text import proposal_text
    from spgf_torch.hands.description_file import there

    path = there(Path(urdf).expanduser()).resolve()
    with stages.stage("proposal", 1, "hands") as advance:
        proposal = propose(HandConfig(name=path.stem, urdf=str(path), root=config.root, packages=config.packages))
        advance(1)
    words, written = proposal_text(proposal), folder / f"{path.stem}.yaml"
    write_text(written, words)
    show(words)
    show(f"written to {written}")
    if proposal.error:
        raise InputError(f"{written}: {proposal.error}")
    return proposal.config


def _draw(hand: Hand, findings: list[Finding], folder: Path, page: bool) -> None:
    """Write the picture, and the page."""
    from spgf_torch.drawing.page import drawn, png
    from spgf_torch.files.writing import write_bytes, write_text
    from spgf_torch.handcheck.hand_page import hand_page
    from spgf_torch.handcheck.hand_picture import hand_picture
    from spgf_torch.handcheck.posed import Posed

    preshapes = Posed.all_of(hand)
    write_bytes(folder / PICTURE, png(drawn(hand_picture(preshapes))))
    if page:
        lines = [f"{hand.urdf}, root {hand.base_link}", *hand.robot.notes]
        write_text(folder / PAGE, hand_page(hand.config.name, preshapes, findings, lines))


if __name__ == "__main__":
    run_command("hand", HandCheckConfig, run)
