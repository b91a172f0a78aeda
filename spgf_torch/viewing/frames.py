"""A folder that others write into: which file is the newest frame, and whether it is whole."""

from __future__ import annotations

from pathlib import Path

from spgf_torch.scene.depth_files import IMAGES
from spgf_torch.scene.files import CLOUDS

State = tuple[int, int]


class Folder:
    """Files of clouds and depth images in a folder; hidden ones, and those called *.part or *.tmp, are none.

    A file is whole when size and time of writing are the same as at the look before. Frames that come faster than they
    are taken are passed over: the newest counts.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._before: dict[Path, State] = {}
        self._taken: dict[Path, State] = {}
        self.passed_over = 0

    def newest(self) -> Path | None:
        """The newest frame that is whole and was not taken before, which is taken with this; None: there is none."""
        now = self._states()
        new = [path for path, state in now.items() if self._before.get(path) == state != self._taken.get(path)]
        self._before = now
        if not new:
            return None
        self.passed_over += len(new) - 1
        self._taken = {path: state for path, state in self._taken.items() if path in now}
        self._taken |= {path: now[path] for path in new}
        return max(new, key=lambda path: (now[path][0], path.name))

    def _states(self) -> dict[Path, State]:
        """Time of writing and size of each file."""
        found = {}
        for path in self.path.iterdir():
            if path.suffix.lower() not in (*CLOUDS, *IMAGES) or path.name.startswith("."):
                continue
            try:
                known = path.stat()
            except OSError:  # gone meanwhile
                continue
            if known.st_size and path.is_file():
                found[path] = known.st_mtime_ns, known.st_size
        return found
