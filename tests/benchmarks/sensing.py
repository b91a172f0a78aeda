"""Depth images of the shipped objects against trimesh's ray API: rays/s.

    python tests/benchmarks/sensing.py

One ray a pixel of the cameras of conf/sensing, cropped to the object as `sense` does. `cast` gives depth and angle of
incidence, in float64. The peer gives the places of the first hits: `mesh.ray` of trimesh, with embree. One thread.
"""

import spgf_torch  # noqa: F401  before torch: it sets how torch's threads wait

# isort: split

import numpy as np
from shared.clouds import objects
from shared.harness import Report, take_turns, threads

from spgf_torch.sensing.cameras import cast, crop, surround
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.sense import sense
from spgf_torch.settings import settings

OBJECTS, ROUNDS = 8, 5


def main() -> None:
    report = Report("sensing", " ".join(__doc__.split("\n\n")[2].split()))
    report.skip("sensing with device=cuda: embree works on the CPU")
    config, chosen = settings(SensingConfig), objects()[:OBJECTS]
    views = [
        (obj.mesh, crop(c, obj.mesh.bounds, 1)) for obj in chosen for c in surround(config, obj.mesh.bounds.mean(0))
    ]
    rays = []
    for mesh, camera in views:
        directions = camera.rays().reshape(-1, 3) @ camera.T_object_camera[:3, :3].T
        rays.append((mesh, np.tile(camera.T_object_camera[:3, 3], (len(directions), 1)), directions))
    count = sum(len(directions) for _, _, directions in rays)
    methods = {
        "cast": lambda: [cast(mesh, camera) for mesh, camera in views],
        "trimesh with embree": lambda: [m.ray.intersects_location(o, d, multiple_hits=False) for m, o, d in rays],
        "sense": lambda: [sense(obj, config, 0) for obj in chosen],
    }
    with threads(1):
        seconds = take_turns(methods, ROUNDS)
    speed = {name: count / value for name, value in seconds.items()}
    for name, per_second in speed.items():
        report.row(method=name, rays=count, rays_per_s=round(per_second))
    report.figure(
        "depth and incidence, rays/s over trimesh's ray API with embree",
        "",
        f"{speed['cast'] / speed['trimesh with embree']:.2f} ({speed['cast'] / 1e6:.2f} million/s)",
    )
    report.figure(
        "an object sensed by four cameras, noise and texlets included", "", f"{1e3 * seconds['sense'] / OBJECTS:.0f} ms"
    )
    report.write()


if __name__ == "__main__":
    main()
