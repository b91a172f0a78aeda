"""Kernels without a place to keep their code."""

from spgf_torch.compiled import compiled


def test_a_kernel_that_cannot_be_kept_is_compiled_all_the_same() -> None:
    """numba refuses to keep functions that come from no file."""
    names: dict = {}
    exec(compile("def twice(x):\n    return 2 * x", "<nowhere>", "exec"), names)
    assert compiled(names["twice"])(21) == 42
