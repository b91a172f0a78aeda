"""Kernels with and without a place to keep their code."""

from pathlib import Path

import numba
import pytest

from spgf_torch.compiled import compiled, is_kept


def test_a_kernel_that_cannot_be_kept_is_compiled_all_the_same() -> None:
    """numba refuses to keep functions that come from no file."""
    names: dict = {}
    exec(compile("def twice(x):\n    return 2 * x", "<nowhere>", "exec"), names)
    assert compiled(names["twice"])(21) == 42


def test_whether_a_kernel_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    kernel = compiled(_doubled)
    assert not is_kept(kernel)
    assert kernel(2) == 4
    assert is_kept(kernel) and not is_kept(_doubled)


def _doubled(x: int) -> int:
    return 2 * x
