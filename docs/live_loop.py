"""Grasps for every frame of a depth camera: no mesh, no Hydra, nothing written.

    python docs/live_loop.py [MODEL] [FRAMES]      MODEL: a name or folder; panda

A simulated camera goes round a mug here. For your own, yield your clouds from `frames`: (N, 3), m, camera frame. Of a
ROS 2 PointCloud2 they are `spgf_torch.ros.clouds.read_cloud(message).points`, and in a node the body of the loop is the
subscriber's callback with a queue of length one: frames that come too fast are dropped.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator

import numpy as np

import spgf_torch
from spgf_torch.errors import InputError
from spgf_torch.objects.library import load_objects
from spgf_torch.paths import root
from spgf_torch.sensing.cameras import cast, surround
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import settings


def frames(count: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """The points (N, 3) that the camera sees, in its frame, and its pose (4, 4) in the world, as a robot knows it."""
    mug = next(obj for obj in load_objects(root() / "data/objects") if obj.name == "mug_coffee")
    for camera in surround(settings(SensingConfig, cameras=count, distance=0.6), mug.mesh.bounds.mean(axis=0)):
        depth, _ = cast(mug.mesh, camera)
        seen = depth > 0
        yield camera.rays()[seen] * depth[seen, None], camera.T_object_camera


def main(run: str, count: int) -> None:
    model = spgf_torch.load(run).ready()
    for points, T_world_camera in frames(count):
        start = time.perf_counter()
        try:
            scene = spgf_torch.Scene.from_points(points, (0.0, 0.0, 0.0), sensing=model.sensing)
        except InputError as error:  # an empty table, a hand before the lens: wait for the next frame
            print(error)
            continue
        grasps = model.predict(scene, top=1)  # table="find" in a scene with a table: no hand reaches below it
        spent = 1000 * (time.perf_counter() - start)
        if not grasps:
            print(f"{len(scene.texlets)} texlets, {spent:.0f} ms: no grasp, {scene.no_grasp or 'none is free'}")
            continue
        best = grasps[0]
        x, y, z = (T_world_camera @ best.T_input_tcp)[:3, 3]
        print(
            f"{len(scene.texlets)} texlets, {spent:.0f} ms: {best.type} at x {x:+.3f} y {y:+.3f} z {z:+.3f} m, "
            f"holds with probability {best.probability:.2f}, {best.support} votes"
        )


if __name__ == "__main__":
    try:
        main(sys.argv[1] if len(sys.argv) > 1 else "panda", int(sys.argv[2]) if len(sys.argv) > 2 else 8)
    except (InputError, ValueError) as error:
        sys.exit(f"live_loop: {error}")
