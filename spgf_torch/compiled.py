"""Loops that torch has no single operation for, compiled for the CPU by numba.

A kernel works on the memory of torch tensors (`tensor.numpy()`), in the calling thread and without the interpreter's
lock, so that `threads.in_parts` can run several. It is compiled at its first call, which takes seconds, and kept
beside its module or in the user's cache (numba's `NUMBA_CACHE_DIR`); where neither can be written, or the disk is full,
it is compiled in every process. Arithmetic keeps its order: the same in every run.

Every loop has a twin of torch's own operations (`ops`), which gives the same and is slower where there is much to do.
What is done once in a process is done sooner without loops: `spare_loops`.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, TypeVar, cast

from spgf_torch.errors import InputError

F = TypeVar("F", bound=Callable[..., object])

SWITCH = "SPGF_OPS"

# Of the loops of a prediction those that take longest to compile: `push`, which is kept after all that it calls.
_LAST = "push_loops.push"


class _Spared:
    """Whether this process loads operators without their loops."""

    loops = False


def spare_loops() -> None:
    """Load operators without their loops from now on, unless `SPGF_OPS=compiled` is in the environment.

    Numba is not even imported then. For a process whose work takes seconds: to compile them takes half a minute, and
    longer to load than they save.
    """
    _Spared.loops = SWITCH not in os.environ


def loops_wanted() -> bool:
    """Whether compiled loops are used where there are any. Raises InputError for a value of SPGF_OPS that says nothing.

    Asked when operators are defined: once in a process.
    """
    wanted = os.environ.get(SWITCH, "torch" if _Spared.loops else "compiled")
    if wanted not in ("compiled", "torch"):
        raise InputError(f"{SWITCH}: expected compiled or torch in the environment, got {wanted!r:.40}")
    return wanted == "compiled"


def compiled(function: F, **options: bool) -> F:
    """The function, compiled in numba's nopython mode, and inlined where another kernel calls it.

    A call that is not inlined copies its named tuples of arrays: some 100 ns, more than many a loop's work. Where loops
    are spared it is the function itself, which nobody calls.
    """
    if _Spared.loops and not loops_wanted():
        return function
    import numba

    compiler = partial(numba.njit, nogil=True, error_model="numpy", forceinline=True, no_cfunc_wrapper=True, **options)
    try:
        kernel = compiler(cache=True)(function)
    except (RuntimeError, OSError):  # no place to keep it
        return cast(F, compiler()(function))
    _may_fail(kernel)
    return cast(F, kernel)


def lean(function: F) -> F:
    """As `compiled`, of a function that neither makes arrays nor returns any: references to arrays are not counted.

    Counting them at each call, inlined or not, takes some 10 ns an array that it is given. Where such a function makes
    an array after all, compiling it fails.
    """
    return compiled(function, _nrt=False)


def loops_kept(loop: str = _LAST) -> bool:
    """Whether compiled loops lie where numba keeps them; else their first calls take half a minute. Imports nothing.

    Args:
        loop: module and function in `ops` that tell it: one that is kept after others.
    """
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        places = [Path(chosen)]
    else:
        home = Path.home() / ("Library/Caches" if sys.platform == "darwin" else ".cache")
        places = [Path(__file__).parent / "ops", Path(os.environ.get("XDG_CACHE_HOME") or home) / "numba"]
    return any(any(place.glob(f"*/{loop}-*.nbi")) for place in places)


def _may_fail(kernel: Any) -> None:
    """Keeping the kernel's code is no condition for using it: a full disk, or what another program left there."""
    kept = kernel._cache
    save, load = kept.save_overload, kept.load_overload

    def save_if_possible(*arguments: Any) -> None:
        with suppress(OSError):
            save(*arguments)

    def load_if_possible(*arguments: Any) -> Any:
        try:
            return load(*arguments)
        except (OSError, EOFError):  # cut off
            return None

    kept.save_overload, kept.load_overload = save_if_possible, load_if_possible
