"""`python -m spgf_torch.hand`: what it writes, what it prints, and how it ends."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import ROOT, here
from composing import config_of
from omegaconf import OmegaConf
from PIL import Image
from wrong_hands import PADS, Wrong, each, load, three_fingers, top, write

from spgf_torch.cli.command import _config, slug
from spgf_torch.cli.command_line import translated
from spgf_torch.errors import InputError
from spgf_torch.hand import run
from spgf_torch.handcheck.check import check_hand
from spgf_torch.handcheck.config import HandCheckConfig
from spgf_torch.handcheck.finding import failed
from spgf_torch.handcheck.hand_picture import hand_picture
from spgf_torch.handcheck.posed import Posed
from spgf_torch.handcheck.standing import simulated_findings, tried_hand
from spgf_torch.hands.description_file import load_hand_file, read_description
from spgf_torch.simulation.config import EpisodeConfig

PANDA = Wrong("", "panda", "")


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    OmegaConf.register_new_resolver("slug", slug, replace=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def settings(*arguments: str) -> HandCheckConfig:
    return _config(HandCheckConfig, config_of("hand", *translated("hand", HandCheckConfig, arguments)))


def test_a_bare_urdf_is_a_setting_of_its_own() -> None:
    Path("jaw.urdf").write_text("<robot/>")
    config = settings("hand=jaw.urdf", "root=palm", "packages.mine=somewhere")
    assert (config.urdf, config.root, config.packages) == ("jaw.urdf", "palm", {"mine": "somewhere"})
    assert settings("hand=panda").urdf is None


def test_a_right_hand_is_drawn_and_tabled(place: Path, capsys: pytest.CaptureFixture) -> None:
    write(place, PANDA)
    run(settings("hand=hand.yaml"), place)
    said = capsys.readouterr().out
    assert re.search(r"(\d+) of \1 checks passed", said) and "FAILS" not in said
    assert said.index("pad on its link") < said.index("stays open")  # by geometry, then in simulation
    with Image.open(place / "hand.png") as picture:
        assert picture.size[0] > 1000
    page = (place / "hand.html").read_text()
    contents = [json.loads(text) for text in re.findall(r'<script type="application/json">(.*?)</script>', page)]
    assert len(contents) == 2 and page.count('class="hand"') == 2
    narrow = contents[0]
    assert len(narrow["poses"]) == len(narrow["pads"]) == len(narrow["joints"]) == 21
    opened, closed = (np.array([pad["at"] for pad in narrow["pads"][step]]) for step in (0, 20))
    np.testing.assert_allclose(opened, [[0, 20, 103.4], [0, -20, 103.4]], atol=0.1)  # mm, NPG is 40 mm open along y
    np.testing.assert_allclose(closed, [[0, 0, 103.4], [0, 0, 103.4]], atol=0.1)


def test_a_bare_urdf_is_described_drawn_and_checked(place: Path, capsys: pytest.CaptureFixture) -> None:
    Path("jaw.urdf").write_bytes((ROOT / "data/hands/panda.urdf").read_bytes())
    run(settings("hand=jaw.urdf", "page=false", "simulate=false"), place)
    written = read_description(place / "jaw.yaml")
    assert "panda_leftfinger" in (place / "config.yaml").read_text()
    assert written.urdf == str(place / "jaw.urdf") and sorted(written.preshapes) == ["narrow", "wide"]
    assert (place / "hand.png").is_file() and not (place / "hand.html").exists()
    assert "# Proposed by" in (said := capsys.readouterr().out) and "stays open" not in said


def test_a_wrong_hand_leaves_its_picture_one_line_and_status_2(place: Path) -> None:
    write(place, Wrong("", "panda", "", change=each("pads", {**PADS, "left": [0, 0.004, 0.045]})))
    done = here("hand", "hand=hand.yaml", "page=false", cwd=place)
    assert done.returncode == 2 and "Traceback" not in done.stderr
    *_, line = done.stderr.strip().splitlines()
    assert line.startswith(
        "hand: hand panda: pad on its link of NPG: expected 1 mm at most, got 4.00 mm off the surface"
    )
    assert line.endswith("; 3 more, the table has all")
    assert done.stdout.count("FAILS") == 4 and "stays open" not in done.stdout  # a wrong hand is not simulated
    (folder,) = (path for path in (place / "outputs/hand").iterdir() if path.name != "latest")
    assert (folder / "hand.png").is_file()


@pytest.mark.parametrize(
    ("argument", "told"),
    [
        ("hand=jam.urdf", "hand: expected a hand's description in YAML or a URDF, got nothing there at jam.urdf"),
        ("hand=mesh.urdf", "expected"),
    ],
)
def test_what_cannot_be_described_is_told(argument: str, told: str, place: Path) -> None:
    Path("mesh.urdf").write_text('<robot name="x"><link name="a"/></robot>')
    with pytest.raises(InputError) as error:
        run(settings(argument), place)
    assert told in str(error.value) and "\n" not in str(error.value)


def test_a_drive_that_cannot_is_refused_before_any_trial(place: Path) -> None:
    """With 20,000 N s/m, 70 N move a finger by 3.5 mm/s: it counts as standing still long before the pads meet."""
    drive = {"effort": 70, "stiffness": 25000, "damping": 20000}
    slow = top("joints", {f"panda_finger_joint{finger}": drive for finger in (1, 2)})
    write(place, Wrong("", "panda", "", change=slow))
    with pytest.raises(InputError, match=r"^hand panda: fingers meet simulated of NPG: expected 12\.0 mm at most"):
        tried_hand(read_description("hand.yaml"), EpisodeConfig())


@pytest.mark.parametrize("name", sorted(path.stem for path in (ROOT / "conf/hand").glob("*.yaml")))
def test_every_shipped_hand_passes_every_check(name: str) -> None:
    hand = load_hand_file(f"conf/hand/{name}.yaml")
    findings = [*check_hand(hand), *simulated_findings(hand, EpisodeConfig())]
    assert len(findings) > 10 and [finding.line() for finding in failed(findings)] == []


def test_a_picture_has_a_row_a_preshape_in_the_colours_of_its_groups(place: Path) -> None:
    figure = hand_picture(Posed.all_of(load(place, Wrong("", "sdh2", "", change=three_fingers(0.5)))))
    first, *others = [axis.get_title() for axis in figure.axes]
    assert re.fullmatch(r"cylinder: open, \d+ mm", first)
    assert others == ["cylinder: closed", "cylinder: open, from the side"]
    faces: Any = figure.axes[0].collections[0].get_facecolor()
    blue, orange = (faces[:, 2] > 1.5 * faces[:, 0]).sum(), (faces[:, 0] > 1.5 * faces[:, 2]).sum()
    assert blue > orange > 100  # two fingers and the thumb
