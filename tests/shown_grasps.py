"""A page with grasps of every kind, with names that would break a careless one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from asymmetric import GRIPPERS, asymmetric

from spgf_torch.drawing.grasp_page import write_scene_page
from spgf_torch.drawing.grasp_scene import Beside, Told
from spgf_torch.drawing.judge_words import WeighedNumber
from spgf_torch.drawing.page_hands import fractions
from spgf_torch.hands.records import Grasp, Voters
from spgf_torch.scene.sensed import Sensed

CENTRE = np.array([0.1, 0.2, 0.3])
HEAD = (
    ("file", "<img src=x onerror=alert(1)>.pcd"),
    ("hand", "claw"),
    ("model", "claw (3b6d4dc3)"),
    ("command", "spgf predict 'a \"b\"'"),
)


def ball(count: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Points and normals of a ball of 40 mm."""
    normals = np.random.default_rng(0).normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return CENTRE + 0.04 * normals, normals


def closing(way: float) -> np.ndarray:
    """(9, 2, 4, 4): the two fingers of `GRIPPERS`, which close along x by `way` each."""
    moves = np.tile(np.eye(4), (9, 2, 1, 1))
    moves[:, 0, 0, 3], moves[:, 1, 0, 3] = way * fractions(), -way * fractions()
    return moves


def voters(gains: list[float]) -> Voters:
    """Votes of texlets on the ball, in turn for the prototypes 3 and 7."""
    points, normals = ball(len(gains))
    prototype = np.where(np.arange(len(gains)) % 2 == 0, 3, 7)
    numbers = (np.array(gains, np.float32), np.full(len(gains), 0.75, np.float32), np.full(len(gains), 12, np.float32))
    return Voters(np.arange(len(gains)), points, normals, prototype, *numbers)


def moved(grasp: Grasp, by: list[float]) -> Grasp:
    T = np.eye(4)
    T[:3, 3] = by
    return replace(
        grasp, **{name: T @ getattr(grasp, name) for name in ("T_input_tcp", "T_input_base", "T_input_pregrasp")}
    )


def shown_grasps() -> list[Grasp]:
    """Four: the second apart from the others, the third of another target, all judged, two with voters."""
    return [
        replace(asymmetric("WPG", 0.9), judged=(0.95, 0.947), voters=voters([1.5, -0.5, 0.25])),
        replace(moved(asymmetric("NPG", 0.6), [0.1, 0.0, 0.0]), judged=(0.8, 0.75), voters=voters([0.5])),
        replace(asymmetric("WPG", 0.3), judged=(0.6, 0.5), target=2),
        replace(asymmetric("NPG", 0.05), judged=(0.1, 0.5)),
    ]


def beside() -> Beside:
    points, _ = ball(900)
    floor = np.array([[x, y, 0.25] for x in np.linspace(0, 0.2, 12) for y in np.linspace(0.1, 0.3, 12)])
    colours = np.random.default_rng(1).integers(0, 256, (len(points) + len(floor), 3)).astype(np.uint8)
    target = np.arange(len(points) + len(floor)) < len(points)
    weighed = (
        WeighedNumber("nearest point to the hand", "10 mm", "3 mm", 2.17),
        WeighedNumber("<b>evil", "1", "0", -1.0),
    )
    return Beside(
        table=np.array([0.0, 0.0, 1.0, -0.25]),
        sensed=Sensed(np.concatenate([points, floor]), target, colours),
        cameras=((np.array([0.1, -0.3, 0.6]), None, None),),
        told=Told(HEAD, ("judge: claw",), ("nothing sure <b>",), ("voxels of 2 mm",)),
        weighed=(weighed,) * 4,
        pictures={3: '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"><circle cx="4" cy="4" r="3"/></svg>'},
        closing={"WPG": closing(0.04), "NPG": closing(0.02)},
    )


def write_shown(folder: Path) -> None:
    """index.html and grasps.png."""
    names = [f"</script><b>evil {i}" for i in range(8)]
    pictures = folder / "index.html", folder / "grasps.png"
    write_scene_page(*pictures, *ball(), shown_grasps(), GRIPPERS, names, beside())
