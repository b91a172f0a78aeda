"""Collision pieces that were cut before: seconds a mesh, and the same in every run."""

from __future__ import annotations

import numpy as np
import torch
import trimesh
from torch import Tensor

from spgf_torch.cache import Cache, code_fingerprint, fingerprint
from spgf_torch.objects.config import CollisionConfig
from spgf_torch.objects.shell import PieceCheck, collision_pieces


def kept_pieces(
    mesh: trimesh.Trimesh, config: CollisionConfig, label: str, cache: Cache
) -> tuple[tuple[np.ndarray, ...], PieceCheck]:
    """What `collision_pieces` returns or raises, from the cache where it is there."""

    def cut() -> dict[str, Tensor]:
        pieces, check = collision_pieces(mesh, config, label)
        return {
            "corners": torch.from_numpy(np.concatenate(pieces)),
            "sizes": torch.tensor([len(piece) for piece in pieces]),
            "check": torch.tensor([check.volume_ratio, check.free_space_kept], dtype=torch.float64),
        }

    shape = (np.asarray(mesh.vertices), np.asarray(mesh.faces))
    kept = cache.tensors("pieces", fingerprint(*shape, config, code_fingerprint("spgf_torch.objects.shell")), cut)
    pieces = tuple(piece.numpy() for piece in kept["corners"].split(kept["sizes"].tolist()))
    return pieces, PieceCheck(len(mesh.faces), len(pieces), *kept["check"].tolist())
