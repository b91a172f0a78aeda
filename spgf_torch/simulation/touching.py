"""What a hand presses on: contacts of its links with objects and table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from spgf_torch.simulation.articulation import physx
from spgf_torch.simulation.tabletop import Tabletop

TABLE = -1  # the table, among objects that are named by their place


class Touching:
    """Contacts of one hand; `groups`: the collision shapes of each opposing group of fingers."""

    def __init__(
        self,
        tabletop: Tabletop,
        articulation: physx.PhysxArticulation,
        groups: Sequence[Sequence[physx.PhysxCollisionShape]],
    ) -> None:
        self._system, self._links = tabletop.system, set(articulation.links)
        self._index = {body: index for index, body in enumerate(tabletop.bodies)} | {tabletop.table: TABLE}
        self._groups = {shape: k for k, shapes in enumerate(groups) for shape in shapes}

    def impulses(self) -> dict[int, float]:
        """Object or `TABLE` -> N s, the normal impulse of the last step; PhysX also lists near pairs, without any."""
        found: dict[int, float] = {}
        for index, _, impulse in self._contacts():
            found[index] = found.get(index, 0.0) + impulse
        return found

    def groups(self) -> dict[int, set[int]]:
        """Object -> the groups of fingers that press on it."""
        found: dict[int, set[int]] = {}
        for index, shape, _ in self._contacts():
            if index != TABLE and shape in self._groups:
                found.setdefault(index, set()).add(self._groups[shape])
        return found

    def _contacts(self) -> Iterator[tuple[int, physx.PhysxCollisionShape, float]]:
        """(object or `TABLE`, shape of the hand, N s), where they press."""
        for contact in self._system.get_contacts():
            first, second = contact.bodies
            if (first in self._links) == (second in self._links):  # none of the hand, or one finger on another
                continue
            ours = 0 if first in self._links else 1
            impulse = sum(float(np.linalg.norm(point.impulse)) for point in contact.points)
            if impulse > 0:
                yield self._index[contact.bodies[1 - ours]], contact.shapes[ours], impulse
