"""`spgf_torch.train`: what the command `train` does, in a program, without Hydra."""

from __future__ import annotations

import multiprocessing
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spgf_torch.command_settings import command_settings
from spgf_torch.errors import InputError
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.files.run_settings import write_settings
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.description_file import is_file_name, read_description
from spgf_torch.progress import ProgressReporter, ReportedProgress, show
from spgf_torch.settings import plain, typed
from spgf_torch.training.given_objects import in_their_names, kept_objects
from spgf_torch.training.run import run

if TYPE_CHECKING:
    import trimesh

    from spgf_torch.predictor import Predictor

    Objects = str | Path | Sequence[str | Path | trimesh.Trimesh] | Mapping[str, str | Path | trimesh.Trimesh]
    Progress = bool | Callable[[str, int, int], Any]


def train(
    objects: Objects | None = None,
    hand: str | Path | HandConfig = "sdh2",
    trials: str | Path | None = None,
    judge: bool = False,
    K: int = 20,
    out: str | Path | None = None,
    progress: Progress = False,
    **settings: Any,
) -> Predictor:
    """Learn a model of one's own objects, hand or trials, as the command `train` does, and load it.

    Fewer than four objects are learned from without cross-validation, so without rates.

    Args:
        objects: a folder as for the command; or a list of meshes (`trimesh.Trimesh`, m) and files of meshes, or a
            mapping by name, which are copied to `objects` in the run's folder. They need a class, such as
            `category="boxes"`. None: `data/objects`.
        hand: the name of a shipped hand, a description in a file, or the settings of one.
        trials: a folder that `simulate` left, or a table of recorded trials (docs/howto/recorded_trials.md). None:
            `data/trials`, and where those are of other objects or another hand, random trials are made.
        judge: whether to learn a judge too, from trials of its own choosing in simulation.
        K: how many prototypes.
        out: a new or empty folder, in which all is left that the command leaves; None: nothing is.
        progress: False: nothing is printed; True: as by the command; or a function, which is called with the name of a
            stage, the number of its steps that are done, and of all.
        settings: any key of conf/train.yaml; of a group a mapping or the name of an option: `folds=3`,
            `episode="fast"`, `sensing={"cameras": 1}`.

    Raises:
        InputError: in one line, for whatever cannot be used; then nothing is left in `out`.
    """
    _check_process()
    if not isinstance(judge, bool):
        raise InputError(f"judge: expected True or False, got {judge!r:.40}")
    with _folder(out) as folder, in_their_names(objects, folder):
        given: dict[str, Any] = {**settings, "K": K, "judge": "learn" if judge else "none"}
        if objects is not None:
            given["objects"] = kept_objects(objects, folder)
        if trials is not None:
            given["trials"] = str(trials)
        config = typed(TrainConfig, command_settings("train", {**given, "hand": _hand(hand)}))
        stages = ProgressReporter() if progress is True else ReportedProgress(progress or None)
        write_settings(folder, config)
        run(config, folder, stages, show if progress is True else _nothing)

        from spgf_torch.predictor import Predictor

        return Predictor.load(folder, config.device)


def _hand(hand: str | Path | HandConfig) -> Any:
    """What `command_settings` takes: the name of a shipped hand, or all values of another."""
    if isinstance(hand, HandConfig):
        return plain(hand)
    return plain(read_description(hand)) if isinstance(hand, Path) or is_file_name(hand) else hand


def _nothing(_: Any) -> None:
    """Say nothing."""


def _check_process() -> None:
    """InputError in a process that is only now importing the script that calls: it would train there once more."""
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise InputError(
            'train: expected a call below if __name__ == "__main__": in a script that starts processes; got one while '
            "a process that it started imports the script"
        )


@contextmanager
def _folder(out: str | Path | None) -> Iterator[Path]:
    """The folder of the run, new or empty; None: one that is gone afterwards. What raises leaves nothing in it."""
    if out is None:
        with tempfile.TemporaryDirectory(prefix="spgf_torch_") as name:
            yield Path(name)
        return
    folder = Path(out).expanduser()
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        empty = not any(folder.iterdir())
    except OSError as error:
        raise InputError(f"out: expected a folder for the run, got {error.strerror} at {folder}") from None
    if not empty:
        raise InputError(f"out: expected a new or an empty folder for the run, got one that is not empty: {folder}")
    try:
        yield folder
    except BaseException:
        for entry in folder.iterdir():
            shutil.rmtree(entry) if entry.is_dir() else entry.unlink()
        for path in made:
            path.rmdir()
        raise
