"""How an operator of this package is made known to torch (`torch.library`).

    @operator("twice(Tensor x) -> Tensor")
    def twice(x: Tensor) -> Tensor:             # by torch's operations, on any device
        return 2 * x

    @twice.on_cpu                               # by compiled loops
    def _twice(x: Tensor) -> Tensor: ...

    @twice.fake                                 # shapes and types alone, for torch.compile
    def _like(x: Tensor) -> Tensor: ...

`twice(x)` is `torch.ops.spgf_torch.twice(x)`. Lists of tensors in a schema are named tuples in Python. Definitions of
low level are used: they cost some 10 us a call, `torch.library.custom_op` twice as much.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, ParamSpec, TypeVar

import numpy as np
import torch
from torch import Tensor

from spgf_torch.compiled import loops_wanted

P = ParamSpec("P")
R = TypeVar("R")

# Every operator by its name.
OPERATORS: dict[str, Operator[..., Any]] = {}

_LIBRARY = torch.library.Library("spgf_torch", "DEF")


class Operator(Generic[P, R]):
    """An operator of torch with more than one implementation.

    Attributes:
        name: it is `torch.ops.spgf_torch.<name>`.
        in_torch: the implementation by torch's operations.
        in_loops: the compiled one, of CPU tensors; the same where there is none.
        overload: what torch calls.
    """

    def __init__(self, schema: str, in_torch: Callable[P, R]) -> None:
        self.name = schema.partition("(")[0]
        self.in_torch = self.in_loops = in_torch
        self.__doc__ = in_torch.__doc__
        _LIBRARY.define(schema, tags=[torch.Tag.pt2_compliant_tag])
        _LIBRARY.impl(self.name, in_torch, "CompositeExplicitAutograd")
        torch.library.register_autograd(f"spgf_torch::{self.name}", self._refuse, lib=_LIBRARY)
        self.overload: Any = getattr(torch.ops.spgf_torch, self.name).default
        OPERATORS[self.name] = self

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        result: R = self.overload(*args, **kwargs)
        return result

    def on_cpu(self, in_loops: Callable[P, R]) -> Callable[P, R]:
        """Use compiled loops for CPU tensors."""
        self.in_loops = in_loops
        if loops_wanted():
            _LIBRARY.impl(self.name, in_loops, "CPU")
        return in_loops

    def fake(self, shapes: Callable[P, R]) -> Callable[P, R]:
        """What outputs look like, for tensors without memory."""
        torch.library.register_fake(f"spgf_torch::{self.name}", shapes, lib=_LIBRARY)
        return shapes

    def _refuse(self, *_: object) -> None:
        raise NotImplementedError(f"spgf_torch::{self.name} has no derivative; detach its inputs")


def operator(schema: str) -> Callable[[Callable[P, R]], Operator[P, R]]:
    """Define an operator by its schema and its implementation in torch."""
    return lambda in_torch: Operator(schema, in_torch)


def unknown_size() -> torch.SymInt:
    """In a fake: a size that depends on values."""
    return torch.library.get_ctx().new_dynamic_size()


def memory(tensor: Tensor, dtype: torch.dtype | None = None) -> np.ndarray:
    """The memory of a CPU tensor for a compiled loop, without a gap; as another type it is a copy."""
    tensor = tensor.detach()
    return np.ascontiguousarray((tensor if dtype in (None, tensor.dtype) else tensor.to(dtype)).numpy())
