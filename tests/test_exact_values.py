"""Values taken as they are: the same instance as OmegaConf's in every case, or its own to decide."""

from dataclasses import dataclass, field, fields
from typing import Any

import pytest
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from spgf_torch.exact_values import InexactError, built, filled


@dataclass
class Inner:
    width: float = 2  # type: ignore[assignment]  # a whole number, which OmegaConf makes a float
    name: str = "a"


@dataclass
class Outer:
    count: int
    sure: bool = True
    share: float = 0.5
    word: str | None = None
    inner: Inner = field(default_factory=lambda: Inner(3.0, "b"))
    own: Inner | None = None
    whatever: Any = None
    sizes: list[float] = field(default_factory=lambda: [1, 2])
    named: dict[str, float] = field(default_factory=dict)
    parts: dict[str, Inner] = field(default_factory=dict)
    needed: dict[str, Any] = field(default="???")  # type: ignore[assignment]  # OmegaConf's MISSING


@dataclass
class Known:
    """A default that OmegaConf merges keys into."""

    known: dict[str, int] = field(default_factory=lambda: {"x": 1})


VALUES = [
    *(None, True, 3, -2, 2.5, 10**30, "x", "3", "", "???", [], [1], [1.5, 2], (1, 2), ["a"], [[1, 2.0]]),
    *({}, {"x": 2}, {"y": 2.5}, {"width": 1}, {"width": "wide"}, {"name": "c", "width": None}, {"a": {"width": 7}}),
    *({"a": {"b": [1, {}]}}, {"a": "???"}, {1: 2}, Inner(4, "d"), Outer(1, needed={}), object()),
]


def by_omegaconf(kind: Any, values: Any) -> Any:
    return OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(kind), values))


@pytest.mark.parametrize("name", [entry.name for entry in fields(Outer)])
def test_what_is_taken_is_what_omegaconf_makes_of_it(name: str) -> None:
    """Of each type every value: equal to the last type within, and plain as OmegaConf has it; or refused here."""
    taken = []
    for value in VALUES:
        given = {"count": 1, "needed": {}, name: value}
        try:
            values = filled(Outer, given)
        except InexactError:
            continue
        expected = by_omegaconf(Outer, given)
        assert repr(built(Outer, values)) == repr(expected), value  # 2 is not 2.0
        assert repr(values) == repr(OmegaConf.to_container(OmegaConf.structured(expected)))
        assert repr(filled(Outer, expected)) == repr(values)
        taken.append(value)
    assert taken and taken != VALUES


def test_keys_that_merge_into_others_are_not_taken() -> None:
    assert filled(Known, {}) == {"known": {"x": 1}} and by_omegaconf(Known, {"known": {"y": 2}}).known == {
        "x": 1,
        "y": 2,
    }
    with pytest.raises(InexactError):
        filled(Known, {"known": {"y": 2}})


def test_nothing_is_taken_that_omegaconf_refuses() -> None:
    least = {"count": 1, "needed": {}}
    wrong = {"other": 2}, {"inner": {"other": 2}}, {"count": "???"}, {"needed": "???"}
    for given in ({}, {"count": 1}, *(least | each for each in wrong), None, []):
        with pytest.raises((OmegaConfBaseException, ValueError)):
            by_omegaconf(Outer, given)
        with pytest.raises(InexactError):
            filled(Outer, given)


def test_an_instance_shares_nothing_with_what_was_given() -> None:
    given = {"count": 1, "needed": {}, "sizes": [1.0], "named": {"a": 1.0}, "whatever": [{"b": []}], "inner": Inner()}
    made = built(Outer, filled(Outer, given))
    made.sizes.append(2.0), made.named.clear(), made.whatever[0]["b"].append(1)
    made.inner.name = "changed"
    assert given == {
        "count": 1,
        "needed": {},
        "sizes": [1.0],
        "named": {"a": 1.0},
        "whatever": [{"b": []}],
        "inner": Inner(),
    }
