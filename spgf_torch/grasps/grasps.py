"""What `Predictor.predict` returns: ranked grasps with what is needed to say, save and show them."""

from __future__ import annotations

import tempfile
import warnings
import webbrowser
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.files.checks import number, rigid_of
from spgf_torch.hands.records import Grasp, Gripper

if TYPE_CHECKING:
    from spgf_torch.predictor import Predictor
    from spgf_torch.scene.scene import Scene

__all__ = ["Grasps", "Source"]


@dataclass(frozen=True)
class Source:
    """What grasps were predicted with and for: a page draws both.

    Attributes:
        T_grasps_scene: (4, 4) float64 pose of the scene's frame in that of the grasps.
    """

    model: Predictor
    scene: Scene
    T_grasps_scene: np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class Grasps(Sequence[Grasp]):
    """Grasps of one hand, best first: a sequence that cannot be changed, a slice of which is one too.

    Poses are (4, 4) float64, m, in the frame of what was given (`spgf_torch.hands`).

    Attributes:
        grasps: best first. grippers: grasp type -> the open hand, of every type that the hand has.
        names: a word for each prototype, such as `rim 7`; none of a judge alone.
        judge: who ranked and what it knew: folder, unseen_space, known, sure (the probability below which nothing is
            to be relied on); None: the votes ranked.
        model: whose they are: the folder, and of votes and judge hand, objects, date and digest; None: not known.
        source: what a page shows beside the grasps; None of grasps from a file, or from another process.
    """

    grasps: tuple[Grasp, ...]
    grippers: Mapping[str, Gripper]
    names: tuple[str, ...] = ()
    judge: Mapping[str, Any] | None = None
    source: Source | None = field(default=None)
    model: Mapping[str, Any] | None = None

    def __len__(self) -> int:
        return len(self.grasps)

    @overload
    def __getitem__(self, index: int) -> Grasp: ...
    @overload
    def __getitem__(self, index: slice) -> Grasps: ...
    def __getitem__(self, index: int | slice) -> Grasp | Grasps:
        found = self.grasps[index]
        return replace(self, grasps=found) if isinstance(found, tuple) else found

    def __iter__(self) -> Iterator[Grasp]:
        return iter(self.grasps)

    def __eq__(self, other: object) -> bool:
        """Whether another sequence has the same grasps in the same order."""
        if not isinstance(other, Grasps | list | tuple):
            return NotImplemented
        return len(self) == len(other) and all(map(_same, self, other))

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        from spgf_torch.grasps.words import table_text

        return table_text(self.grasps)

    def _repr_html_(self) -> str:
        from spgf_torch.grasps.words import table_html

        return table_html(self.grasps)

    def __getstate__(self) -> dict[str, Any]:
        """Without model and scene, which are large: for another process, or a copy."""
        return {**self.__dict__, "source": None}

    @property
    def best(self) -> Grasp | None:
        """The first; None where there is none."""
        return self.grasps[0] if self.grasps else None

    def of_type(self, grasp_type: str) -> Grasps:
        """Those of one grasp type. Raises InputError for a type that the hand has not."""
        if grasp_type not in self.grippers:
            raise InputError(f"grasp type: expected one of {', '.join(self.grippers)}; got {grasp_type!r:.40}")
        return self._where(grasp.type == grasp_type for grasp in self.grasps)

    def above(self, probability: float) -> Grasps:
        """Those that hold with this probability at least, 0 to 1."""
        least = number(probability, "probability", 0.0, 1.0)
        return self._where(grasp.probability >= least for grasp in self.grasps)

    def _where(self, kept: Iterator[bool]) -> Grasps:
        return replace(self, grasps=tuple(grasp for grasp, keep in zip(self.grasps, kept, strict=True) if keep))

    def transform(self, T: Any) -> Grasps:
        """All of them in another frame, such as a robot's base.

        Args:
            T: (4, 4) pose of the frame that they are in, in the other: p_other = T @ p_input; m.

        Raises:
            InputError: T is not rigid.
        """
        T = rigid_of(T, "T")
        source = self.source and replace(self.source, T_grasps_scene=T @ self.source.T_grasps_scene)
        return replace(self, grasps=tuple(grasp.transform(T) for grasp in self.grasps), source=source)

    def to_dict(self) -> dict[str, Any]:
        """What `grasps.json` holds, as plain values; its frame `input` is the one that the grasps are in."""
        from spgf_torch.formats.grasps_json import grasps_dict

        return grasps_dict(self.grasps, self.grippers, self.judge_said(), self.model, self.notes)

    @property
    def notes(self) -> tuple[str, ...] | None:
        """What was assumed of the scene, left out or looks wrong, a line each; None: without their scene."""
        return None if self.source is None else self.source.scene.notes

    def judge_said(self) -> dict[str, Any] | None:
        """`judge`, and whether none of these grasps is sure."""
        if self.judge is None:
            return None
        return {**self.judge, "nothing_sure": not self.grasps or self.grasps[0].probability < self.judge["sure"]}

    def save(self, folder: str | Path, formats: str | Sequence[str] | None = None, replace: bool = False) -> list[Path]:
        """Write them as files that other programs read.

        Args:
            folder: made if need be.
            formats: one or some of json (`grasps.json`), isaac (`isaac_grasp.yaml`), moveit (`moveit_grasps.json`),
                graspnet (`graspnet.npy` and its joints: grasps of two-finger jaws alone), glb (`grasps.glb`: hands, and
                the cloud where it is known, for Blender), page (`index.html`, `grasps.png`); None: all but the page.
            replace: files of these names that are there; nothing else in the folder is touched.

        Returns:
            The paths of what was written.

        Raises:
            InputError: an unknown format, a folder that is a file, files that are there and not `replace`, a page of
                grasps without their scene. Nothing is written then.
        """
        from spgf_torch.grasps.saving import left_out, save

        written = save(self, folder, formats, replace)
        if (left := left_out(self)) and any(path.name == "graspnet.npy" for path in written):
            warnings.warn(left, stacklevel=2)
        return written

    def show(self) -> Path:
        """Write the page into a new temporary folder and open it in a browser; returns the page's path.

        It draws grasps and cloud in the frame of the scene that was given, also after `transform`.

        Raises:
            InputError: grasps without their scene.
        """
        folder = Path(tempfile.mkdtemp(prefix="spgf_grasps_"))
        page = next(path for path in self.save(folder, "page") if path.suffix == ".html")
        webbrowser.open(page.as_uri())
        return page


def _same(grasp: Grasp, other: object) -> bool:
    """Whether another is a grasp of the same values."""
    return grasp is other or (isinstance(other, Grasp) and grasp.to_dict() == other.to_dict())
