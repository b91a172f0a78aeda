"""An object as a real camera saw it once: what is learned from in the place of a mesh."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property

from spgf_torch.sensing.texlets import Texlets


@dataclass(frozen=True)
class RecordedView:
    """What one recording shows of an object.

    Attributes:
        name: of the view, unique. object_name: whose it is; views of one object teach, and are novel, together.
        category: one of `objects.config.CLASSES`.
        texlets: of the recording, in its frame, m.
    """

    name: str
    object_name: str
    category: str
    texlets: Texlets

    @cached_property
    def digest(self) -> str:
        """SHA-256 over all that is learned from it."""
        sha = hashlib.sha256(f"{self.name}|{self.object_name}|{self.category}".encode())
        for tensor in (self.texlets.positions, self.texlets.normals):
            sha.update(tensor.contiguous().numpy().tobytes())
        return sha.hexdigest()
