"""What true geometry says of the ten best grasps in clutter, as planned for one thing and among neighbours.

    python tests/benchmarks/planning_in_clutter.py [HAND] [packed|pile] [VIEWS] [SCENES] [neighbours' key=value ...]

Of the ten best, and of the first, the share whose open hand, and whose way from 10 cm back, touch neither an object nor
the table (FCL, the objects' own pieces); on how many of the objects some free grasp lies; seconds of the processor. The
judges are the shipped ones, which have met all of these objects: what is compared is planning. Seeds are below 1000.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import fcl
import numpy as np
import trimesh
import yaml

from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.fingers import triangle_tree
from spgf_torch.hands.hand import Hand, load_hand
from spgf_torch.hands.records import Grasp
from spgf_torch.objects.library import load_objects
from spgf_torch.paths import root
from spgf_torch.predictor import Predictor
from spgf_torch.proposing.config import proposing_named
from spgf_torch.scene.assembly import scene_of_views
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.scene import Scene
from spgf_torch.scene.views import View
from spgf_torch.sensing.cameras import cast, surround
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.noise import measure
from spgf_torch.sensing.sense import TABLE
from spgf_torch.settings import settings, typed
from spgf_torch.simulation.arrangements import Placed, arranged
from spgf_torch.simulation.clutter_config import ArrangementConfig
from spgf_torch.simulation.precheck import hull

WAY, STEP = 0.1, 0.01  # m back along the approach, looked at in steps
MIDDLE = np.array([0.0, 0.0, 0.05])  # m, what the cameras look at
BOX = {"crop_low": [-0.25, -0.25, -0.05], "crop_high": [0.25, 0.25, 0.45]}


def sensed(placed: tuple[Placed, ...], views: int, seed: int) -> Scene:
    """The whole table as so many cameras see it."""
    square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * TABLE / 2
    table = trimesh.Trimesh(square, [[0, 1, 2], [0, 2, 3]], process=False)
    things = [each.obj.mesh.copy().apply_transform(each.T_world_object) for each in placed]
    mesh, sensing = trimesh.util.concatenate([table, *things]), replace(settings(SensingConfig), cameras=views)
    rng, images = np.random.default_rng(seed), []
    for camera in surround(sensing, MIDDLE):
        depth, cosine = cast(mesh, camera)
        images.append(View(measure(depth, cosine, camera.K[0, 0], sensing, rng), camera))
    return scene_of_views(images, settings(SceneConfig, table=[0.0, 0.0, 1.0, 0.0], **BOX), sensing, rng)


def body(pieces: list[trimesh.Trimesh], T: np.ndarray) -> fcl.CollisionObject:
    """The surface of some pieces at a pose."""
    return fcl.CollisionObject(triangle_tree(pieces), fcl.Transform(T[:3, :3].copy(), T[:3, 3].copy()))


def free(hand: Hand, grasp: Grasp, objects: list[fcl.CollisionObject]) -> tuple[bool, bool]:
    """Whether the open hand touches nothing at the grasp, and from `WAY` back to there."""
    pieces = list(hand.preshapes[grasp.type].shapes)
    corners = np.concatenate([piece.vertices for piece in pieces])
    touches = []
    for back in np.arange(0, WAY + 1e-9, STEP):
        T = np.array(grasp.T_input_tcp, dtype=np.float64)
        T[:3, 3] -= back * T[:3, 2]
        its, result = body(pieces, T), fcl.CollisionResult
        met = any(fcl.collide(its, other, fcl.CollisionRequest(), result()) for other in objects)
        touches.append(met or float((corners @ T[2, :3] + T[2, 3]).min()) < 0)
    return not touches[0], not any(touches)


def nearest(grasp: Grasp, objects: list[fcl.CollisionObject]) -> int:
    """The object whose surface is nearest to the TCP."""
    tcp = fcl.CollisionObject(fcl.Sphere(1e-4), fcl.Transform(np.asarray(grasp.T_input_tcp[:3, 3], dtype=np.float64)))
    return int(np.argmin([fcl.distance(tcp, each, fcl.DistanceRequest(), fcl.DistanceResult()) for each in objects]))


def arrangement(kind: str) -> ArrangementConfig:
    folder = root() / "conf" / "arrangement"
    values = [yaml.safe_load((folder / f"{name}.yaml").read_text(encoding="utf-8")) for name in ("packed", kind)]
    return typed(ArrangementConfig, {k: v for part in values for k, v in part.items() if k != "defaults"})


def planners(hand: str, changes: dict[str, object]) -> dict[str, Predictor]:
    many = proposing_named("clutter")
    assert many.neighbours is not None
    many = replace(many, neighbours=replace(many.neighbours, **changes))
    folder = root() / "data" / "judge" / hand
    return {"one thing": Predictor.load(folder).ready(), "neighbours": Predictor.load(folder, proposing=many).ready()}


def main() -> None:
    given = [word for word in sys.argv[1:] if "=" not in word]
    hand, kind, views, scenes = [*given, *("sdh2", "pile", "1", "20")[len(given) :]]
    changes = {key: yaml.safe_load(value) for key, value in (w.split("=") for w in sys.argv[1:] if "=" in w)}
    objects, config, told = load_objects(Path(root() / "data" / "objects")), arrangement(kind), planners(hand, changes)
    its = load_hand(typed(HandConfig, next(iter(told.values())).judged.judge.settings["hand"]))  # type: ignore[union-attr]
    rows: dict[str, list[tuple[float, ...]]] = {name: [] for name in told}
    for seed in range(int(scenes)):
        placed = arranged(objects, 5, seed, config)
        scene = sensed(placed, int(views), seed)
        solid = [body([hull(part) for part in each.obj.parts], each.T_world_object) for each in placed]
        for name, planner in told.items():
            clock = [time.process_time()]
            best = planner.predict(scene, 10)[:10]
            clock.append(time.process_time())
            truth = [free(its, grasp, solid) for grasp in best] or [(False, False)]
            on = {nearest(grasp, solid) for grasp, (_, way) in zip(best, truth, strict=False) if way}
            seconds = next(b - a for a, b in pairwise(clock))
            rows[name].append((*np.mean(truth, axis=0), *truth[0], len(on), len(placed), seconds))
    print(f"{hand}, {kind}, {views} views, {scenes} scenes; %: free at the grasp / also on the way")
    for name, row in rows.items():
        ten, way, first, first_way, on, of, seconds = np.mean(row, axis=0)
        shares = f"ten best {100 * ten:.0f} / {100 * way:.0f}, first {100 * first:.0f} / {100 * first_way:.0f}"
        worst = max(r[-1] for r in row)
        print(f"{name:12s} {shares}; free ones on {on:.1f} of {of:.1f} objects; {seconds:.2f} s, at most {worst:.2f}")


if __name__ == "__main__":
    main()
