"""Loops that torch has no single operation for, compiled for the CPU by numba.

A kernel works on the memory of torch tensors (`tensor.numpy()`), in the calling thread and without the interpreter's
lock, so that `threads.in_parts` can run several. It is compiled at its first call, which takes seconds, and kept
beside its module or in the user's cache (numba's `NUMBA_CACHE_DIR`); where neither can be written, it is compiled in
every process. Arithmetic keeps its order: the same in every run.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """The function, compiled in numba's nopython mode."""
    try:
        return cast(F, numba.njit(nogil=True, error_model="numpy", cache=True)(function))
    except RuntimeError:  # no place to keep it
        return cast(F, numba.njit(nogil=True, error_model="numpy")(function))
