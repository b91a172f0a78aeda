"""What holds for every operator: both implementations agree, torch can trace it, and nobody else asks for a device."""

import importlib
import pkgutil
import re
from pathlib import Path

import pytest
import torch
from operator_cases import CASES
from torch import Tensor

import spgf_torch
from spgf_torch import ops
from spgf_torch.compiled import loops_wanted
from spgf_torch.errors import InputError
from spgf_torch.ops.registration import OPERATORS

for module in pkgutil.iter_modules(ops.__path__):
    importlib.import_module(f"spgf_torch.ops.{module.name}")

PACKAGE = Path(spgf_torch.__file__).parent

# float64 may differ in its last bits: by the order of sums, or by square roots. float32 is equal to the bit, but for:
# torch's vectorised functions round differently at the ends of the parts that its threads take.
ROUNDING = {"lloyd": 1e-6, "settle": 1e-6, "describe": 1e-6}


def listed(value: object) -> list[Tensor]:
    return [value] if isinstance(value, Tensor) else list(value)  # type: ignore[call-overload]


def test_every_operator_is_tried() -> None:
    assert OPERATORS.keys() == CASES.keys()


@pytest.mark.parametrize("name", sorted(OPERATORS))
def test_both_implementations_agree(name: str) -> None:
    operator, said = OPERATORS[name], []
    for case in CASES[name]():
        compiled, in_torch = listed(operator.in_loops(*case)), listed(operator.in_torch(*case))
        assert len(compiled) == len(in_torch)
        for a, b in zip(compiled, in_torch, strict=True):
            assert (a.dtype, a.shape) == (b.dtype, b.shape)
            share = 1e-12 if a.dtype == torch.float64 else ROUNDING.get(name, 0.0)
            torch.testing.assert_close(a, b, rtol=share, atol=share, equal_nan=True)
            said.append(a)
    assert any(len(a.unique()) > 1 for a in said if a.numel())  # it says something


@pytest.mark.parametrize("name", sorted(OPERATORS))
def test_torch_can_trace_it(name: str) -> None:
    torch.library.opcheck(OPERATORS[name].overload, CASES[name]()[0])


@pytest.mark.parametrize("name", sorted(OPERATORS))
def test_a_derivative_is_refused_and_not_zero(name: str) -> None:
    case = [
        x.clone().requires_grad_() if isinstance(x, Tensor) and x.is_floating_point() else x for x in CASES[name]()[0]
    ]
    outputs = [out for out in listed(OPERATORS[name](*case)) if out.requires_grad]
    for out in outputs:
        with pytest.raises(NotImplementedError, match=f"spgf_torch::{name} has no derivative"):
            out.sum().backward()


@pytest.mark.parametrize("name", sorted(OPERATORS))
def test_tensors_are_made_where_the_arguments_are(name: str) -> None:
    """With another device as torch's default: what is made without a device meets its arguments elsewhere and fails."""
    for case in CASES[name]():
        with torch.device("meta"):
            found = listed(OPERATORS[name].in_torch(*case))
        assert {tensor.device.type for tensor in found} == {"cpu"}


def test_only_operators_ask_for_a_device() -> None:
    asking = [
        str(path.relative_to(PACKAGE))
        for path in PACKAGE.rglob("*.py")
        if path.parent.name != "ops" and re.search(r"device\.type|is_cuda", path.read_text())
    ]
    assert sorted(asking) == ALLOWED


# Lightning is told the name of a device, and results of different ones are kept apart.
ALLOWED = ["baselines/data.py", "baselines/fit.py", "experiment/learning.py"]


def test_operators_stand_below_all_rooms() -> None:
    """They import geometry and what all may use."""
    below = r"(ops|geometry|compiled|errors|threads)\b"
    for path in (PACKAGE / "ops").glob("*.py"):
        found = re.findall(r"^(?:from|import) spgf_torch\.(\S+)", path.read_text(), re.MULTILINE)
        assert all(re.match(below, name) for name in found), path


def test_the_switch_takes_two_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SPGF_OPS", "torch")
    assert not loops_wanted()
    monkeypatch.setenv("SPGF_OPS", "fast")
    with pytest.raises(InputError, match="SPGF_OPS: expected compiled or torch in the environment, got 'fast'"):
        loops_wanted()
