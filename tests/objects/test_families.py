"""Families of shapes: how numbers are drawn, that objects are whole and typical, and that counts do not change them."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import yaml

from spgf_torch.errors import InputError
from spgf_torch.objects.families import Drawn, Family, check_solid, draw, read_families, turns
from spgf_torch.objects.library import Description, build, load_object
from spgf_torch.paths import find
from spgf_torch.settings import typed

RANGES = find("conf/sizes/household.yaml")
MASSES = (0.01, 0.7)
BLOCK = {
    "product": "Block",
    "category": "boxes",
    "density": "400-600",
    "shape": "box",
    "sizes": {"long": "0.1-0.2", "wide": "0.5 long"},
    "dimensions": {"size": ["long", "wide", "0.5-0.7 wide"], "edge": 0.004},
}


@pytest.fixture(scope="module")
def shipped() -> dict[str, Family]:
    return read_families(RANGES)


@pytest.fixture(scope="module")
def one_each(shipped: dict[str, Family]) -> list[Drawn]:
    return [draw(name, family, 3, 5, MASSES) for name, family in shipped.items()]


def block(**changes: object) -> Family:
    return typed(Family, BLOCK | changes)


def test_sizes_are_drawn_first_and_dimensions_are_shares_of_them() -> None:
    """Two sizes, three lengths and the edge take a number each of the stream, then the density."""
    at = np.random.default_rng([7, 2, 0x831B9722]).random(7)  # CRC-32 of "block"
    long, wide = 0.1 + 0.1 * at[0], 0.5 * (0.1 + 0.1 * at[0])
    drawn = draw("block", block(), 2, 7, (0.001, 5.0))
    size = [round(float(length), 4) for length in (long, wide, (0.5 + 0.2 * at[4]) * wide)]
    assert drawn.description.dimensions == {"size": size, "edge": 0.004}
    density = 400 + 200 * at[6]
    assert drawn.description.mass == round(density * drawn.built.mesh.volume, 3)
    assert drawn.description.name == "block_7_0002" and drawn.built.mass == drawn.description.mass


def test_draws_fill_their_range_evenly() -> None:
    lengths = np.array([draw("b", block(), n, 0, (0.001, 5)).description.dimensions["size"][0] for n in range(60)])
    assert lengths.min() < 0.11 and lengths.max() > 0.19
    assert np.histogram(lengths, bins=4, range=(0.1, 0.2))[0].min() > 7


def test_what_weighs_too_much_is_drawn_again() -> None:
    masses = [draw("b", block(), n, 0, (0.05, 0.2)).description.mass for n in range(20)]
    free = [draw("b", block(), n, 0, (0.001, 5)).description.mass for n in range(20)]
    assert min(masses) >= 0.05 and max(masses) <= 0.2 < max(free)
    kept = [i for i, mass in enumerate(free) if mass <= 0.2]
    assert kept and [masses[i] for i in kept] == [free[i] for i in kept]


def test_families_take_turns_and_counts_agree() -> None:
    names = ["a", "b", "c"]
    many = list(turns(names, 31, 4))
    assert list(turns(names, 10, 4)) == many[:10] and len(set(many)) == 31
    for start in range(0, 30, 3):
        assert {name for name, _ in many[start : start + 3]} == set(names)
    assert Counter(name for name, _ in many).most_common()[0][1] == 11
    assert len({tuple(name for name, _ in many[start : start + 3]) for start in range(0, 30, 3)}) > 3
    assert list(turns(names, 30, 5)) != many[:30]


def test_an_object_depends_on_seed_family_and_number(shipped: dict[str, Family], one_each: list[Drawn]) -> None:
    again = draw("mug", read_families(RANGES, ["mug"])["mug"], 3, 5, MASSES)
    first = next(each for each in one_each if each.description.name == "mug_5_0003")
    assert again.values == first.values and again.built.digest == first.built.digest
    others = [draw("mug", shipped["mug"], 4, 5, MASSES), draw("mug", shipped["mug"], 3, 6, MASSES)]
    assert len({each.built.digest for each in [again, *others]}) == 3


def test_every_shipped_family_makes_whole_objects_near_ours(one_each: list[Drawn]) -> None:
    """Their surfaces are closed and tiled (`check_solid`); their extents and masses lie about those of data/objects."""
    counts = Counter(each.description.category for each in one_each)
    assert min(counts[name] / len(one_each) for name in ("containers", "boxes", "curved")) > 0.25
    assert len({each.description.name for each in one_each}) == len(one_each) == 47
    for each in one_each:
        check_solid(each.built)
        low, high = np.sort(each.built.mesh.extents)[[0, -1]]
        assert 0.015 < low < 0.2 and 0.04 < high < 0.3, each.description.name
        assert MASSES[0] <= each.built.mass <= MASSES[1]


def test_a_description_is_read_as_it_was_drawn(tmp_path: Path, one_each: list[Drawn]) -> None:
    for each in one_each[::6]:
        (tmp_path / "a.yaml").write_text(yaml.safe_dump(each.values))
        assert load_object(tmp_path / "a.yaml").digest == each.built.digest


def test_pieces_that_do_not_tile_are_refused() -> None:
    whole = build(Description("a", "boxes", 0.1, "box", {"size": [0.1, 0.05, 0.04]}))
    half = whole.parts[0] * [0.5, 1.0, 1.0]
    with pytest.raises(InputError, match=r"expected pieces that fill 200 cm3, got 100"):
        check_solid(type(whole)(**{**vars(whole), "parts": (half,)}))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"density": "heavy"}, r"density: expected a number, a range a-b or a share of a size, got heavy"),
        ({"sizes": {"long": "0.9 wide"}}, r"sizes\.long: expected .*, got 0\.9 wide"),
        (
            {"dimensions": {"size": ["long", "wide", "0.1 - 0.2"]}},
            r"dimensions\.size: .* of long, wide, got 0\.1 - 0\.2",
        ),
        ({"dimensions": {"size": ["long", ""]}}, r"dimensions\.size: expected"),
        ({"dimensions": {"size": ["long", "wide"]}}, r"size: expected three lengths"),
        ({"dimensions": {"size": ["long", "wide", "wide"], "wall": 1}}, r"wall"),
        ({"density": 100_000}, r"mass: expected 0\.01 to 0\.7 kg, got"),
    ],
)
def test_ranges_that_make_nothing_are_told(changes: dict, message: str) -> None:
    with pytest.raises(InputError, match=rf"^b: expected ranges that make an object, .*{message}"):
        draw("b", block(**changes), 0, 0, MASSES)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{}", r"expected families of shapes by name, got {}"),
        ("- a", r"expected families of shapes by name"),
        ("a/b: {}", r"a/b: family: expected letters"),
        ("box: {product: Box}", r"box: .*expected a value, got none"),
        ("box: 3", r"box: "),
        ("box: {product: Box, colour: red}", r"box: colour: expected a key of Family"),
    ],
)
def test_files_that_hold_no_families(tmp_path: Path, content: str, message: str) -> None:
    file = tmp_path / "f.yaml"
    file.write_text(content)
    with pytest.raises(InputError, match=rf"f\.yaml: {message}"):
        read_families(file)


def test_unknown_families_are_named() -> None:
    with pytest.raises(InputError, match=r"^families: expected some of mug, .*; got cat, dog"):
        read_families(RANGES, ["mug", "cat", "dog"])
    with pytest.raises(InputError, match=r"got none"):
        read_families(RANGES, [])
