"""Two views of an object brought together by their features alone: no model, no grasps, no RANSAC.

    python docs/registration.py [OBJECT] [APART] [PICTURE]      saucepan, 50 deg, outputs/registration.png

Two simulated depth cameras, APART degrees of azimuth apart, look at the object; each knows only its own frame. Of your
own clouds, (N, 3), m, camera frame, of one thing without its table, `Scene.from_points(cloud, (0, 0, 0)).texlets` is a
view.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib
import numpy as np
import torch

from spgf_torch import Texlets
from spgf_torch.drawing.style import DPI, LETTERS
from spgf_torch.errors import InputError
from spgf_torch.features.registration import register
from spgf_torch.geometry.se3 import inverse, relative_angle, rotation_of, transform_points
from spgf_torch.objects.library import load_object
from spgf_torch.paths import root
from spgf_torch.sensing.cameras import surround
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.sense import observe
from spgf_torch.settings import settings

FIRST_DEG = 20.0  # azimuth of camera a
COLOURS = {"a": "#0072B2", "b": "#D55E00"}


def view(name: str, azimuth_deg: float) -> tuple[Texlets, torch.Tensor]:
    """Texlets of an object in the frame of a noisy camera, and the camera's pose (4, 4), which is the truth."""
    mesh = load_object(root() / f"data/objects/{name}.yaml").mesh
    sensing = settings(SensingConfig, cameras=1, azimuth_deg=azimuth_deg)
    cameras = surround(sensing, mesh.bounds.mean(axis=0))
    seen = observe(mesh, cameras, sensing, np.random.default_rng(0))
    T_object_camera = torch.from_numpy(cameras[0].T_object_camera)
    T = inverse(T_object_camera).float()
    return Texlets(transform_points(T, seen.positions), seen.normals @ rotation_of(T).mT), T_object_camera


def draw(path: Path, a: torch.Tensor, b: torch.Tensor, T_a_b: torch.Tensor) -> None:
    """Both clouds of texlets as camera a looks at them, before and after."""
    matplotlib.use("agg")
    from matplotlib import pyplot

    with pyplot.rc_context(LETTERS):
        figure, panels = pyplot.subplots(1, 2, figsize=(6.4, 3.2), sharex=True, sharey=True)
        for panel, T, title in zip(panels, (torch.eye(4), T_a_b), ("as given", "registered"), strict=True):
            moved = transform_points(T.to(b), b)
            for name, points in (("a", a), ("b", moved)):
                x, y = 1000 * points[:, 0], 1000 * points[:, 1]
                panel.scatter(x, y, s=7, color=COLOURS[name], linewidths=0, alpha=0.75, label=f"view {name}")
            panel.set(title=title, aspect="equal", xlabel="x (mm)")
        panels[0].set_ylabel("y (mm)")
        panels[0].invert_yaxis()  # a camera's y points down
        figure.legend(*panels[0].get_legend_handles_labels(), loc="lower center", ncols=2, markerscale=2)
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=DPI / 2, bbox_inches="tight")
        pyplot.close(figure)


def main(name: str, apart_deg: float, picture: Path) -> None:
    (a, T_object_a), (b, T_object_b) = view(name, FIRST_DEG), view(name, FIRST_DEG + apart_deg)
    eye = torch.zeros(3)  # of a camera in its own frame
    found = register(a, b, viewpoints=(eye, eye))
    truth = inverse(T_object_a) @ T_object_b
    middle = b.positions.double().mean(0)[None]
    off = transform_points(found.T_a_b, middle) - transform_points(truth, middle)
    print(f"{name}: {len(a)} and {len(b)} texlets, {found.agreeing} matches agree, {found.overlap:.0%} of b lie on a")
    turned = float(relative_angle(found.T_a_b, truth).rad2deg())
    print(f"off by {turned:.1f} deg and {1000 * float(off.norm()):.1f} mm")
    draw(picture, a.positions, b.positions, found.T_a_b)
    print(f"picture in {picture}")


if __name__ == "__main__":
    try:
        name, apart, picture = [*sys.argv[1:], *("saucepan", "50", "outputs/registration.png")[len(sys.argv) - 1 :]]
        main(name, float(apart), Path(picture))
    except (InputError, ValueError) as error:
        sys.exit(f"registration: {error}")
