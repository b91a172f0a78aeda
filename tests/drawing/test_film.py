"""The film of a round: which frames, how long they stand, and what is seen in them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from clutter_rounds import hand, round_
from matplotlib.colors import to_rgb
from PIL import Image

from spgf_torch.drawing import film
from spgf_torch.drawing.clutter_records import Round
from spgf_torch.drawing.film import sampled, write_film
from spgf_torch.drawing.style import FAILED, HELD
from spgf_torch.errors import InputError


def test_times_are_sampled_evenly_up_to_the_last() -> None:
    """0.1 s apart from 3 to 5 s; every 0.75 s: 3, 3.75 (3.7 or 3.8), 4.5, and the end."""
    times = np.linspace(3.0, 5.0, 21)
    assert sampled(times, 0.1).tolist() == list(range(21))
    assert sampled(times, 0.76).tolist() == [0, 8, 15, 20]
    assert sampled(times[:1], 0.1).tolist() == [0]


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[np.ndarray], list[int]]:
    """A small film of the round: frames and how long each is shown, ms."""
    path = tmp_path_factory.mktemp("film") / "round.gif"
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(film, "SIZE", (200, 150))
        patched.setattr(film, "FRAMES", 14)  # 4 s of motion in 10 frames: 0.4 s apart
        write_film(path, round_(), hand())
    frames, shown = [], []
    with Image.open(path) as image:
        for index in range(image.n_frames):
            image.seek(index)
            frames.append(np.asarray(image.convert("RGB")).astype(int))
            shown.append(image.info["duration"])
        assert image.info["loop"] == 0
    return frames, shown


def pixels(frame: np.ndarray, colour: str) -> int:
    """How many have the hue of a colour, in light or shade."""
    wanted, grey = np.array(to_rgb(colour)), np.ones(3) / np.sqrt(3)
    wanted, seen = (value - np.outer(value @ grey, grey).reshape(np.shape(value)) for value in (wanted, frame / 255))
    length = np.linalg.norm(seen, axis=-1)
    alike = seen @ wanted / np.linalg.norm(wanted) > 0.97 * length
    return int((alike & (length > 0.15)).sum())


def test_the_hand_takes_the_colour_of_the_outcome(filmed: tuple[list[np.ndarray], list[int]]) -> None:
    """Two attempts of 2 s in 6 frames each: each stands at its end, red, then green."""
    frames, shown = filmed
    assert shown == [400] * 5 + [900] + [400] * 5 + [2500]
    red, green = ([pixels(frame, colour) for frame in frames] for colour in (FAILED, HELD))
    assert red[5] > 300 and max(red[:5] + red[6:]) < 30
    assert green[11] > 300 and max(green[:11]) < 30


def test_things_move(filmed: tuple[list[np.ndarray], list[int]]) -> None:
    """The can, orange, rises by 0.2 m in the second attempt; in the first nothing but the hand does."""
    frames, _ = filmed
    heights = [np.nonzero((frame[..., 0] - frame[..., 2] > 90).any(axis=1))[0].min() for frame in frames]
    assert abs(heights[0] - heights[4]) <= 1 and heights[6] - heights[10] > 20


def test_nothing_to_film(tmp_path: Path) -> None:
    whole = round_()
    bare = replace(whole, attempts=tuple(replace(each, clip=None) for each in whole.attempts))
    for each in (bare, Round("ours", "pile", whole.objects, (), "no grasp")):
        with pytest.raises(InputError, match="film: expected a round with a recorded attempt; got none"):
            write_film(tmp_path / "a.gif", each, hand())
    assert not list(tmp_path.iterdir())
