"""A frame and its grasps on a page of viser: the cloud, hands coloured by probability, and sliders."""

from __future__ import annotations

from pathlib import Path
from threading import RLock
from typing import TYPE_CHECKING, Any

import numpy as np
from trimesh import transform_points

from spgf_torch.drawing.grasp_scene import look
from spgf_torch.drawing.page_hands import fractions
from spgf_torch.drawing.style import success_colours
from spgf_torch.grasps.grasps import Grasps
from spgf_torch.hands.hand import closing_poses
from spgf_torch.hands.records import Grasp
from spgf_torch.predictor import Predictor
from spgf_torch.scene.scene import Scene

if TYPE_CHECKING:
    import viser

TARGET, OBSTACLE = (90, 90, 90), (125, 156, 192)
DOTS = {"/targets": 0.004, "/obstacles": 0.002}  # m; texlets are 5 mm apart, obstacles voxels of 2 mm
SEEN_HANDS = 3  # that are shown at first
AWAY = (2.5, 0.35)  # of the eye from the first frame: times its extent, and m more, so that hands are in the picture


class Page:
    """The page of a model's grasps; `show` draws a frame in the place of the one before.

    Args:
        server: of viser. model: whose hands are drawn. most: hands that a frame has at most.
    """

    def __init__(self, server: viser.ViserServer, model: Predictor, most: int) -> None:
        self._server, self._lock = server, RLock()  # sliders call from viser's threads
        self._shapes = {name: each.shapes for name, each in model.grippers.items()}
        assert model.hand is not None  # a loaded model has it
        self._moves = {name: closing_poses(model.hand, name, fractions()) for name in model.grippers}
        self._grasps: Grasps | None = None
        self._hands: list[Any] = []
        gui = server.gui
        self._words = gui.add_markdown("waiting for a frame")
        self._count = gui.add_slider("hands", 0, most, 1, min(SEEN_HANDS, most))
        self._least = gui.add_slider("least probability", 0.0, 1.0, 0.01, 0.0)
        self._closed = gui.add_slider("closed", 0.0, 1.0, 0.05, 0.0)
        for slider in (self._count, self._least, self._closed):
            slider.on_update(lambda _: self._draw_hands())

    def show(self, path: Path, scene: Scene, grasps: Grasps, seconds: float) -> None:
        """Draw a frame: targets grey, obstacles blue, and the hands that the sliders choose."""
        with self._lock, self._server.atomic():
            self._points("/targets", scene.texlets.positions.numpy(), TARGET)
            self._points("/obstacles", scene.obstacles.numpy(), OBSTACLE)
            if self._grasps is None:
                self._look(scene)
            self._grasps = grasps
            best = f"best {grasps[0].probability:.0%}" if grasps else f"no grasp: {scene.no_grasp or 'none is free'}"
            self._words.content = f"**{_plain(path.name)}**: {len(grasps)} grasps in {seconds:.2f} s, {_plain(best)}"
            self._draw_hands()

    def _look(self, scene: Scene) -> None:
        """Turn the page's eye, and that of whoever opens it later, to where the first frame is."""
        points = scene.texlets.positions.numpy()
        if not len(points):
            return
        low, high, eye = points.min(axis=0), points.max(axis=0), look(scene.texlets.normals.numpy())
        centre = (low + high) / 2
        place = centre + (AWAY[0] * float(np.linalg.norm(high - low)) + AWAY[1]) * eye.towards
        self._server.scene.set_up_direction(eye.up)
        cameras: list[Any] = [
            self._server.initial_camera,
            *(each.camera for each in self._server.get_clients().values()),
        ]
        for camera in cameras:
            camera.position, camera.look_at = place, centre

    def refuse(self, path: Path, why: str) -> None:
        """Say why a frame cannot be used; the one before stays."""
        self._words.content = f"**{_plain(path.name)}**: {_plain(why)}"

    def shown(self) -> list[Grasp]:
        """The grasps that the sliders choose, best first."""
        known = self._grasps or ()
        return [grasp for grasp in known if grasp.probability >= self._least.value][: int(self._count.value)]

    def _draw_hands(self) -> None:
        with self._lock, self._server.atomic():
            for hand in self._hands:
                hand.remove()
            self._hands = [self._hand(i, grasp) for i, grasp in enumerate(self.shown())]

    def _hand(self, i: int, grasp: Grasp) -> Any:
        """The collision shapes of a hand, as far closed as the slider says."""
        vertices, faces = hand_mesh(self._shapes[grasp.type], self._moves[grasp.type], float(self._closed.value))
        colour = tuple((255 * success_colours(np.array([grasp.probability]))[0]).astype(int).tolist())
        placed = transform_points(vertices, grasp.T_input_tcp).astype(np.float32)
        how: dict[str, Any] = {"color": colour, "opacity": 0.7, "flat_shading": True, "side": "double"}
        return self._server.scene.add_mesh_simple(f"/hands/{i}", placed, faces, **how)

    def _points(self, name: str, points: np.ndarray, colour: tuple[int, int, int]) -> None:
        self._server.scene.add_point_cloud(name, points, colour, point_size=DOTS[name], precision="float32")


def hand_mesh(shapes: Any, moves: np.ndarray, closed: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3), m, in the TCP's frame, and faces (F, 3) of a hand that is closed so far, 0 open to 1.

    Args:
        shapes: of the open hand.
        moves: (S, shapes, 4, 4), `hands.hand.closing_poses`; between two of the S it goes straight.
    """
    at = closed * (len(fractions()) - 1)
    low = min(int(at), len(moves) - 2)
    corners, faces, start = [], [], 0
    for k, shape in enumerate(shapes):
        ends = [transform_points(shape.vertices, moves[low + i, k]) for i in (0, 1)]
        corners.append(ends[0] + (at - low) * (ends[1] - ends[0]))
        faces.append(np.asarray(shape.faces) + start)
        start += len(shape.vertices)
    return np.concatenate(corners), np.concatenate(faces)


def _plain(words: str) -> str:
    """Words of a file without markup."""
    return "".join(f"\\{c}" if c in "\\`*_{}[]<>()#+-.!|" else c for c in words)
