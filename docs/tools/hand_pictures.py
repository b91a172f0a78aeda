"""The pictures of docs/hands.md: every preshape of the shipped hands, open and closed.

    python docs/tools/hand_pictures.py [HAND ...]

They are those of `python -m spgf_torch.hand`, smaller.
"""

from __future__ import annotations

import io
import sys
from pathlib import Path

import yaml
from PIL import Image

from spgf_torch.drawing.page import drawn, png
from spgf_torch.handcheck.hand_picture import hand_picture
from spgf_torch.handcheck.posed import Posed
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import load_hand
from spgf_torch.paths import root
from spgf_torch.settings import typed

HANDS = ("sdh2_fingers", "robotiq_2f", "robotiq_3f", "so101")
WIDTH = 900  # px


def main(hands: list[str]) -> None:
    for name in hands:
        told = yaml.safe_load((root() / f"conf/hand/{name}.yaml").read_text())
        figure = hand_picture(Posed.all_of(load_hand(typed(HandConfig, told))))
        image = Image.open(io.BytesIO(png(drawn(figure)))).convert("RGB")
        image = image.resize((WIDTH, round(image.height * WIDTH / image.width)), Image.Resampling.LANCZOS)
        image.quantize(48).save(Path(f"docs/images/hand_{name}.png"), optimize=True)


if __name__ == "__main__":
    main(sys.argv[1:] or list(HANDS))
