"""A model's folder as it is kept by a name, shipped and shared: votes, judge, hand and a card, in the Hub's layout.

`model.json`, `model.safetensors`; `judge.json`, `judge.safetensors`; `hand/`; `README.md` with a YAML header.
"""

from __future__ import annotations

import hashlib
import re
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from uuid import uuid4

from spgf_torch.affordance.model import DIGEST, SMALL, GraspModel, save_model
from spgf_torch.affordance.small_config import SmallConfig
from spgf_torch.files.card_header import card_header
from spgf_torch.files.digests import digest_of
from spgf_torch.files.writing import write_text
from spgf_torch.hands.carried_hand import carry
from spgf_torch.hands.hand import Hand
from spgf_torch.proposing.judge import ARRAYS, Judge, save_judge

CARD = "README.md"
SHOWN = 8  # digits of a digest in words
_HEADER = re.compile(r"\A---\n.*?\n---\n", re.DOTALL)
# What `_card` says before what is told of votes and judge.
_LOAD = 'model = spgf_torch.Predictor.from_pretrained("THIS_FOLDER")'
_OWN = re.compile(rf"\A\s*# [^\n]*.*?{re.escape(_LOAD)}\n```\s*", re.DOTALL)


@dataclass(frozen=True)
class Identity:
    """Which model this is.

    Attributes:
        hand: its name. objects: how many taught it. objects_digest: SHA-256 over their digests.
        date: of learning, YYYY-MM-DD; None: older models do not say.
        digest: SHA-256 of its tensors, if it is in a file.
        small: whether points were left out.
    """

    hand: str
    objects: int
    objects_digest: str
    date: str | None
    digest: str | None
    small: bool = False

    @staticmethod
    def of(known: GraspModel | Judge) -> Identity:
        """That of a votes' model or of a judge."""
        about: Mapping[str, Any] = known.about
        taught = known.taught if isinstance(known, Judge) else known.settings.get("taught")
        digests = sorted(map(str, taught.values())) if isinstance(taught, Mapping) else []
        objects_digest = hashlib.sha256("".join(digests).encode()).hexdigest()
        name = str(known.settings["hand"]["name"])
        return Identity(name, len(digests), objects_digest, about.get("date"), about.get(DIGEST), SMALL in about)

    def words(self) -> str:
        """`hand sdh2, 50 objects (1a2b3c4d), of 2026-11-29, digest 5e6f7a8b`."""
        date = f"of {self.date}" if self.date else "of an unknown date"
        digest = (self.digest or "none")[:SHOWN]
        return f"hand {self.hand}, {self.objects} objects ({self.objects_digest[:SHOWN]}), {date}, digest {digest}"

    def to_dict(self) -> dict[str, Any]:
        """As plain values, for `grasps.json`."""
        return dict(vars(self))


def write_model(
    place: Path, model: GraspModel | None, judge: Judge | None, hand: Hand, small: SmallConfig | None, cards: str
) -> int:
    """Write a whole folder in the place of what is there; returns the bytes of its files.

    Args:
        small: how the votes are made small; None: they are written whole.
        cards: what is told of votes and judge, Markdown.
    """
    place.parent.mkdir(parents=True, exist_ok=True)
    part = place.parent / f".{place.name}-{uuid4().hex}.part"
    part.mkdir()
    try:
        if model is not None:
            save_model(_without_paths(model), part, small)
        if judge is not None:
            save_judge(judge, part)
        carry(hand, part)
        said = _card(place.name, _identities(part, model, judge), hand, small if model else None, cards)
        write_text(part / CARD, said)
        size = sum(file.stat().st_size for file in part.rglob("*") if file.is_file())
        if place.is_dir():
            old = part.with_suffix(".old")
            place.rename(old)
            part.rename(place)
            shutil.rmtree(old)
        else:
            part.rename(place)
    finally:
        if part.exists():
            shutil.rmtree(part)
    return size


# Settings of a run that say where things lay on a machine; a model that travels is the same without.
_PATHS = ("cache", "cache_gb", "workers", "device", "runner", "address", "own_trials", "trials", "objects", "name")


def _without_paths(model: GraspModel) -> GraspModel:
    kept = {key: value for key, value in model.settings.items() if key not in _PATHS}
    return GraspModel(model.centres, model.condensed, model.grid, model.calibration, kept, model.about)


def body(folder: Path | None) -> str:
    """What the cards in a folder tell of votes and judge, headings one down; empty where there is none.

    Of a card that `write_model` made that is what follows its own words, which the next card has anew.
    """
    names = () if folder is None else (CARD, "JUDGE.md")
    texts = [(folder / name).read_text(encoding="utf-8") for name in names if folder and (folder / name).is_file()]
    return "\n".join(_told(_HEADER.sub("", text)) for text in texts)


def _told(text: str) -> str:
    told, made = _OWN.subn("", text)
    return told if made else re.sub(r"^#", "##", text, flags=re.MULTILINE)


def _identities(folder: Path, model: GraspModel | None, judge: Judge | None) -> dict[str, Identity]:
    """Of votes and judge, as they stand in the folder."""
    parts = (("Votes", model, "model.safetensors"), ("Judge", judge, ARRAYS))
    return {
        name: replace(Identity.of(part), digest=digest_of(folder / file))
        for name, part, file in parts
        if part is not None
    }


def _card(name: str, parts: Mapping[str, Identity], hand: Hand, small: SmallConfig | None, cards: str) -> str:
    lines = [card_header(hand.config.name, library_name="spgf_torch", pipeline_tag="robotics")]
    lines += [f"# {name}: grasps of the hand {hand.config.name}", ""]
    lines += [f"- {which}: {part.words()}." for which, part in parts.items()]
    if small is not None:
        lines.append(
            f"- Made small: the best supported points, {small.points:,} at most, {small.probabilities} levels of "
            f"probability and {small.supports} of support; `model.json` says of which model, and how many went."
        )
    lines += [f"- Hand: `hand/`, digest {hand.digest[:SHOWN]}.", ""]
    lines += [f"`spgf predict FILE --model {name}` by its name, `--model THIS_FOLDER` from anywhere; or"]
    lines += ["", "```python", "import spgf_torch", "", _LOAD, "```", "", cards]
    return "\n".join(lines).rstrip() + "\n"
