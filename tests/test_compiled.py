"""Kernels with and without a place to keep their code, and processes that spare them."""

from pathlib import Path

import numba
import numpy as np
import pytest
from commands import ROOT, python

from spgf_torch.compiled import compiled, loops_kept
from spgf_torch.ops import push_loops


def test_a_kernel_that_cannot_be_kept_is_compiled_all_the_same() -> None:
    """numba refuses to keep functions that come from no file."""
    names: dict = {}
    exec(compile("def twice(x):\n    return 2 * x", "<nowhere>", "exec"), names)
    assert compiled(names["twice"])(21) == 42


def test_whether_loops_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Seen by the search's own loops, compiled into a folder and found there."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    kernel = compiled(push_loops._offsets_of.py_func)
    pose, places = np.eye(4, dtype=np.float32), np.zeros((2, 1, 3), np.float32)
    assert kernel((pose, places, np.zeros((2, 1, 3)), np.zeros((2, 3))), np.ones((2, 1), np.bool_))
    assert not loops_kept()  # the last to be kept is missing
    (kept,) = tmp_path.glob("*/push_loops._offsets_of-*.nbi")
    kept.rename(kept.with_name(kept.name.replace("_offsets_of", push_loops.push.__name__)))
    assert loops_kept() and not loops_kept("kmeans.add_nearest")


def test_spared_loops_are_not_loaded() -> None:
    """A process that spares them runs torch's operations and does not import numba, unless the environment says so."""
    lines = (
        "import sys; from spgf_torch.compiled import spare_loops; spare_loops()",
        "import torch; from spgf_torch.ops.farthest_first import farthest_first",
        "points = torch.tensor([[0.0], [3.0], [1.0]]).double()",
        "order = farthest_first(points, points[:, 0].square(), 2).tolist()",
        "print(order, 'numba' in sys.modules)",
    )
    for wanted, expected in ((None, "[1, 0] False"), ("compiled", "[1, 0] True")):
        done = python("-c", "\n".join(lines), cwd=ROOT, SPGF_OPS=wanted)
        assert done.stdout.strip() == expected, done.stderr
