"""Which model and judge plan, by fold where each scene is met by those that have not seen its objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from spgf_torch.clearing.config import NETWORK, OURS, ClutterConfig
from spgf_torch.errors import InputError
from spgf_torch.files.given_paths import NONE, model_and_judge, model_of_hand

if TYPE_CHECKING:
    from spgf_torch.objects.grasp_object import GraspObject


@dataclass(frozen=True)
class Learned:
    """Folders of the votes' model and of the judge that ranks; None: there is none.

    Attributes:
        held_out: each scene is met by those of its fold.
    """

    votes: Path | None
    judge: Path | None
    held_out: bool

    @staticmethod
    def of(config: ClutterConfig) -> Learned:
        """Raises InputError for settings that do not go together, and folders that do not hold what they should."""
        if config.method == NETWORK and (config.hand.name != "panda" or not config.cgn):
            wrong = f"hand={config.hand.name}" if config.hand.name != "panda" else "no cgn=PYTHON"
            raise InputError(f"method: expected {NETWORK} with hand=panda and cgn=PYTHON, got {wrong}")
        if config.method != OURS and not config.held_out:
            return Learned(None, None, False)
        return Learned(*model_and_judge(config.model or model_of_hand(config.hand.name), config.judge), config.held_out)

    def folders(self, fold: int | None) -> tuple[str, str]:
        """Model and judge of a fold, as `Predictor.load` takes them."""
        if fold is None:
            return str(self.votes or NONE), str(self.judge or NONE)
        from spgf_torch.experiment.held_out import FOLDER, JUDGES

        votes = NONE if self.votes is None else str(self.votes / FOLDER / str(fold))
        return votes, NONE if self.judge is None else str(self.judge / JUDGES / str(fold))

    def pools(self, objects: Sequence[GraspObject]) -> list[tuple[int | None, list[GraspObject]]]:
        """From which objects scenes are drawn in turn: those of each fold, or all. Each with its fold.

        Raises InputError where the folds know none of the objects, or model and judge have not the same folds.
        """
        if not self.held_out:
            return [(None, list(objects))]
        from spgf_torch.experiment.held_out import FOLDER, JUDGES, novel_by_fold

        known = [novel_by_fold(run, room) for run, room in ((self.votes, FOLDER), (self.judge, JUDGES)) if run]
        if any(other != known[0] for other in known[1:]):
            raise InputError(f"judge: expected the folds of the model in {self.votes}, got others in {self.judge}")
        novel = known[0]
        fold_of = {obj.name: novel[obj.name][0] for obj in objects if novel.get(obj.name, (0, ""))[1] == obj.digest}
        if len(fold_of) < len(objects):
            other = next(obj.name for obj in objects if obj.name not in fold_of)
            raise InputError(
                f"held_out: expected objects of the run's cross-validation, got {other}: no such object there"
            )
        return [(fold, [obj for obj in objects if fold_of[obj.name] == fold]) for fold in sorted(set(fold_of.values()))]

    def digests(self) -> list[str]:
        """Of all that may plan, in an order of its own; each file carries that of its tensors."""
        from spgf_torch.files.digests import digest_of

        rooms = [room for room in (self.votes, self.judge) if room is not None]
        names = ("*/*/model.json", "*/*/judge.json") if self.held_out else ("model.json", "judge.json")
        return [digest_of(path) for room in rooms for name in names for path in sorted(room.glob(name))]
