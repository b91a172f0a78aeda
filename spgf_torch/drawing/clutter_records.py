"""What the page (`clutter_page`) and the film (`film`) of clutter show: rounds of attempts, and rates of methods.

Plain records that a command fills from its own. World frame: the table is z = 0, z up; m, rad, s. A round's things are
numbered by its `objects`: `present`, `taken` and a clip's `objects` are indices into them, also of equal objects.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from spgf_torch.objects.grasp_object import GraspObject


@dataclass(frozen=True)
class Share:
    """A rate, 0 to 1, and the ends of its 95 % interval over scenes; NaN where there is none."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class MethodRates:
    """What one method reached on all scenes.

    Attributes:
        name: as it is shown. scenes, objects, attempts: how many there were.
        success: of the attempts (GSR). cleared: of the objects (DR).
        causes: why attempts failed -> how many; those that succeeded are not in it.
        seconds: of processor time that a plan takes, the median; NaN where unknown.
    """

    name: str
    scenes: int
    objects: int
    attempts: int
    success: Share
    cleared: Share
    causes: Mapping[str, int]
    seconds: float = float("nan")


@dataclass(frozen=True)
class Summary:
    """The head of the page.

    Attributes:
        title: of the page. methods: the main one first.
        lines: of plain text, what was run. notes: of plain text, how to read it and what is doubtful.
    """

    title: str
    methods: Sequence[MethodRates]
    lines: Sequence[str] = ()
    notes: Sequence[str] = ()


@dataclass(frozen=True)
class View:
    """The scene before an attempt, and what was sensed of it.

    Attributes:
        present: (N,) indices of the objects that were there. poses: (N, 4, 4) T_world_object of them.
        points: (M, 3) the sensed cloud above the table, world frame; some are drawn.
        cameras: (C, 4, 4) T_world_camera, +z forward.
    """

    present: Sequence[int]
    poses: np.ndarray
    points: np.ndarray
    cameras: np.ndarray


@dataclass(frozen=True)
class Clip:
    """The recorded motion of one attempt in F frames.

    Attributes:
        times: (F,) s from the beginning of the attempt, rising.
        objects: (N,) indices. object_poses: (F, N, 4, 4) T_world_object.
        links: (L,) names of the hand's links. link_poses: (F, L, 4, 4) T_world_link.
    """

    times: np.ndarray
    objects: Sequence[int]
    object_poses: np.ndarray
    links: Sequence[str]
    link_poses: np.ndarray


@dataclass(frozen=True)
class Tried:
    """One attempt.

    Attributes:
        view: the scene before it. grasp_type: of the hand. T_world_tcp: (4, 4), the open hand at the grasp.
        probability: of success, 0 to 1, as it was foretold; NaN where the method foretells none.
        success: whether exactly one object was lifted and held. cause: a word for why it failed, none where it did not.
        taken: index of the object that was lifted, if any. touched: words on what the approach met, if anything.
        clip: None: it was not recorded.
    """

    view: View
    grasp_type: str
    T_world_tcp: np.ndarray
    probability: float
    success: bool
    cause: str = "none"
    taken: int | None = None
    touched: str = ""
    clip: Clip | None = field(default=None, repr=False)


@dataclass(frozen=True)
class Round:
    """The clearing of one scene by one method.

    Attributes:
        method: the name in `Summary.methods`. name: of the scene, such as `pile 12`.
        objects: all that the scene began with. attempts: in order.
        ended: a word or two for why it ended: clear, two failures, no grasp.
        last: what was left and seen at the end; None where nothing was left or it was not sensed again.
        seconds: of processor time that planning took for the whole round; NaN where unknown.
    """

    method: str
    name: str
    objects: Sequence[GraspObject]
    attempts: Sequence[Tried]
    ended: str
    last: View | None = None
    seconds: float = float("nan")

    @property
    def cleared(self) -> int:
        """Objects that were taken away."""
        return sum(attempt.success for attempt in self.attempts)

    @property
    def failed(self) -> int:
        return len(self.attempts) - self.cleared
