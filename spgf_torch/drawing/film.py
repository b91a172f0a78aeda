"""A round of clutter as a short film (GIF): the recorded motion of each attempt, and how it ended."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from spgf_torch.drawing.clutter_records import Clip, Round, Tried
from spgf_torch.drawing.clutter_scene import link_solids, object_solids, overview, table_solids
from spgf_torch.drawing.rendered import Solid, rendered
from spgf_torch.drawing.style import FAILED, HELD
from spgf_torch.errors import InputError
from spgf_torch.files.writing import write_bytes
from spgf_torch.hands.hand import Hand

SIZE = (480, 360)  # pixels
FRAMES = 90  # at most, all attempts together: some 15 s of one core, and below 3 MB
RATE = 10  # frames a second at most
PAUSE, END = 0.9, 2.5  # s that the last frame of an attempt stands, and the last of all
COLOURS = 256  # of the film
LETTERS, EDGE = 16, 8  # pixels: height of the letters, and room about them
INK = "#1d2733"


def write_film(path: Path, each: Round, hand: Hand) -> None:
    """Write the film of a round; attempts that were not recorded are left out.

    Raises:
        InputError: no attempt was recorded.
    """
    frames = list(_frames(each, hand))
    if not frames:
        raise InputError("film: expected a round with a recorded attempt; got none")
    frames[-1] = (frames[-1][0], END)
    seconds = [shown for _, shown in frames]
    # Every fourth frame and all that stand: they have the colours of things and hand, and of all outcomes.
    shown_colours = [image for k, (image, shown) in enumerate(frames) if k % 4 == 0 or shown >= PAUSE]
    palette = _stacked(shown_colours).quantize(COLOURS)
    first, *others = (image.quantize(palette=palette, dither=Image.Dither.NONE) for image, _ in frames)
    out = io.BytesIO()
    durations = [10 * round(100 * shown) for shown in seconds]  # ms; a GIF counts hundredths of a second
    first.save(out, "GIF", save_all=True, append_images=others, duration=durations, loop=0)
    write_bytes(path, out.getvalue())


def sampled(times: np.ndarray, step: float) -> np.ndarray:
    """Indices of the recorded times (F,) nearest to every `step` s from the first on, and of the last."""
    wanted = np.arange(times[0], times[-1], step)
    found = np.abs(times[None] - wanted[:, None]).argmin(axis=1)
    indices: np.ndarray = np.unique([*found, len(times) - 1])
    return indices


def _frames(each: Round, hand: Hand) -> Iterator[tuple[Image.Image, float]]:
    """Pictures, and for how long each is shown, s."""
    recorded = [(number, one) for number, one in enumerate(each.attempts, start=1) if one.clip]
    length = sum(float(one.clip.times[-1] - one.clip.times[0]) for _, one in recorded if one.clip)
    step = max(1 / RATE, length / max(FRAMES - 2 * len(recorded), 1))
    table, objects, camera = table_solids(), object_solids(each.objects), overview(SIZE)
    for number, attempt in recorded:
        clip = attempt.clip
        assert clip is not None
        links = link_solids(hand, clip.links)
        head = f"{number} of {len(each.attempts)}: {attempt.grasp_type}{_foretold(attempt)}"
        indices = sampled(clip.times, step)
        for index in indices:
            over = index == indices[-1]
            colour = (HELD if attempt.success else FAILED) if over else None
            solids = [*table, *_placed(clip, index, objects, links, colour)]
            image = rendered(solids, camera)
            _write(image, [head, *(_ending(each, number) if over else [])], colour or INK)
            yield image, PAUSE if over else step


def _placed(
    clip: Clip, index: int, objects: list[Solid], links: list[Solid | None], colour: str | None
) -> Iterator[Solid]:
    """Objects and hand of a frame; `colour`: of the hand."""
    for which, T in zip(clip.objects, clip.object_poses[index], strict=True):
        yield objects[which].placed(T)
    for link, T in zip(links, clip.link_poses[index], strict=True):
        if link is not None:
            yield replace(link, colour=colour or link.colour).placed(T)


def _ending(each: Round, number: int) -> list[str]:
    """How an attempt ended; after the last one, how the round did."""
    attempt = each.attempts[number - 1]
    words = f"failed, {attempt.cause}"
    if attempt.success:
        words = "held" if attempt.taken is None else f"held: {each.objects[attempt.taken].name.replace('_', ' ')}"
    round_too = number == len(each.attempts)
    return [words, *([f"{each.cleared} of {len(each.objects)} cleared, {each.ended}"] if round_too else [])]


def _foretold(attempt: Tried) -> str:
    return "" if math.isnan(attempt.probability) else f", foretold {100 * attempt.probability:.0f} %"


def _write(image: Image.Image, lines: list[str], colour: str) -> None:
    """Lines in the lower left corner, which the table leaves free; the first in ink."""
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(LETTERS)
    for up, line in enumerate(lines):
        at = (EDGE, image.height - EDGE - 1.3 * LETTERS * (3 - up))
        draw.text(at, line, INK if up == 0 else colour, font)


def _stacked(images: list[Image.Image]) -> Image.Image:
    return Image.fromarray(np.concatenate([np.asarray(image) for image in images]))
