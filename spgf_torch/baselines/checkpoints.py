"""What a network in training leaves on disk: checkpoints and tensors, each with its digest (`digests`)."""

from __future__ import annotations

import io
import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save
from torch import Tensor

from spgf_torch.errors import InputError
from spgf_torch.files.digests import BLANK, KEY, check_seal, sealed
from spgf_torch.files.reading import existing, unreadable
from spgf_torch.files.writing import write_bytes

AGAIN = "remove it, and its fold is learned again"


def write_checkpoint(path: Path, content: Any) -> None:
    """A file of `torch.save` with its seal behind it, where readers of zip files take it for a comment."""
    stream = io.BytesIO()
    torch.save(content, stream)
    write_bytes(path, sealed(stream.getvalue() + BLANK))


def read_checkpoint(path: Path, device: torch.device | str = "cpu") -> Any:
    """What `write_checkpoint` left; no code of it is run. Raises InputError where it is damaged."""
    _check(path, "a checkpoint")
    try:
        return torch.load(path, map_location=device, weights_only=True)
    except (pickle.UnpicklingError, EOFError, RuntimeError, ValueError, KeyError, OSError) as error:
        raise unreadable(path, "a checkpoint", error, f"a damaged one; {AGAIN}") from None


def write_tensors(path: Path, tensors: Mapping[str, Tensor]) -> None:
    """A safetensors file with its seal."""
    write_bytes(path, sealed(save(dict(tensors), {KEY: BLANK.decode()})))


def read_tensors(path: Path, *names: str) -> dict[str, Tensor]:
    """What `write_tensors` left, with these names in it. Raises InputError where it is damaged."""
    _check(path, "tensors")
    try:
        found = load_file(path)
    except (SafetensorError, OSError, ValueError, KeyError) as error:
        raise unreadable(path, "tensors", error, f"a damaged file; {AGAIN}") from None
    if missing := [name for name in names if name not in found]:
        raise InputError(f"{path}: expected {', '.join(names)}; missing {', '.join(missing)}; {AGAIN}")
    return found


def _check(path: Path, what: str) -> None:
    try:
        check_seal(existing(path), what)
    except InputError as error:
        raise InputError(f"{error}: {AGAIN}") from None
