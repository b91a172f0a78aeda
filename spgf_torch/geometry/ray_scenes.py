"""The scenes in which rays are cast at meshes (embree's)."""

from __future__ import annotations

import trimesh


def forget_scene(mesh: trimesh.Trimesh) -> None:
    """Drop the scene that a mesh keeps once a ray has been cast at it; the next ray makes it anew, in milliseconds.

    A process has room for some thousand: each has a device of its own, whose threads take one of Linux's 1024 keys of
    thread-specific data. The one after them ends the process with a segmentation fault.
    """
    mesh.ray = type(mesh.ray)(mesh)
