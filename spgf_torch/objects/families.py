"""Families of household shapes and objects drawn from them: descriptions as in `data/objects`, sizes from ranges.

A family is a description in which numbers may be drawn (`conf/sizes/household.yaml` says how they are written). An
object depends on the seed, its family's ranges and its number in the family alone, so that sets of different counts
share their objects.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from omegaconf import MISSING
from scipy.spatial import ConvexHull

from spgf_torch.errors import InputError
from spgf_torch.files.reading import yaml_values
from spgf_torch.objects.config import CLASSES
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.objects.library import Description, build
from spgf_torch.objects.manifest import check_name
from spgf_torch.objects.shapes import SHAPES
from spgf_torch.settings import choice, text, typed

ATTEMPTS = 100  # draws of one object; of conf/sizes/household.yaml one in 15 is drawn again
DIGITS = 4  # of a length: 0.1 mm
TILING = 1e-6  # share of the volume by which convex pieces may miss what the surface encloses
MOST_CORNERS = 255  # of a convex piece: PhysX takes no more

_NUMBER = r"\d*\.?\d+(?:e-?\d+)?"
_DRAWN = re.compile(rf"(?:(?P<low>{_NUMBER})(?:-(?P<high>{_NUMBER}))?)?(?:(?:^|\s+)(?P<size>[a-z_]+))?")


@dataclass
class Family:
    """A kind of object. Numbers in `density` (kg/m3), `sizes` and `dimensions` (m) may be drawn.

    Attributes:
        product: what it is, for the first line of a description.
        sizes: named lengths that dimensions are shares of; drawn first, in this order.
        dimensions: those of the shape.
    """

    product: str = text()
    category: str = choice(*CLASSES)
    density: Any = field(default=MISSING)
    shape: str = choice(*SHAPES)
    sizes: dict[str, Any] = field(default_factory=dict)
    dimensions: dict[str, Any] = field(default=MISSING)


@dataclass(frozen=True)
class Drawn:
    """An object drawn: its description, what it stands for, and what is built of it."""

    description: Description
    product: str
    built: GraspObject

    @property
    def values(self) -> dict[str, Any]:
        """The description as plain values, in the order of `data/objects`."""
        return asdict(self.description)


def read_families(path: Path, only: Sequence[str] | None = None) -> dict[str, Family]:
    """The families of a YAML file, by name in the file's order; of `only` those.

    Raises InputError, which names file and family, for what is no family, and for names that are not there.
    """
    values = yaml_values(path, "families of shapes")
    if not isinstance(values, dict) or not values:
        raise InputError(f"{path}: expected families of shapes by name, got {values!r}")
    unknown = [name for name in only or () if name not in values]
    if unknown or (only is not None and not only):
        raise InputError(
            f"families: expected some of {', '.join(map(str, values))}; got {', '.join(unknown) or 'none'}"
        )
    families = {}
    for name in values if only is None else [name for name in values if name in only]:
        try:
            check_name(str(name), "family")
            families[str(name)] = typed(Family, values[name])
        except InputError as error:
            raise InputError(f"{path}: {name}: {error}") from None
    return families


def turns(families: Sequence[str], count: int, seed: int) -> Iterator[tuple[str, int]]:
    """Family and number in the family of `count` objects: round after round of all families, each in another order."""
    for i in range(count):
        turn, at = divmod(i, len(families))
        if at == 0:
            order = np.random.default_rng([seed, turn]).permutation(len(families))
        yield families[order[at]], turn


def draw(name: str, family: Family, number: int, seed: int, masses: tuple[float, float]) -> Drawn:
    """Draw the object with this number in a family: `NAME_SEED_NUMBER`.

    What makes no shape, weighs less or more than `masses` (kg) or has pieces that do not tile it is drawn again.
    Raises InputError where that never ends.
    """
    rng = np.random.default_rng([seed, number, zlib.crc32(name.encode())])
    last = ""
    for _ in range(ATTEMPTS):
        try:
            return _drawn(f"{name}_{seed}_{number:04d}", family, rng, masses)
        except InputError as error:
            last = str(error)
    raise InputError(f"{name}: expected ranges that make an object, got none in {ATTEMPTS} draws; the last: {last}")


def _drawn(name: str, family: Family, rng: np.random.Generator, masses: tuple[float, float]) -> Drawn:
    sizes: dict[str, float] = {}
    for key, value in family.sizes.items():
        sizes[key] = _number(value, sizes, rng, f"sizes.{key}")
    dimensions = {key: _rounded(value, sizes, rng, f"dimensions.{key}") for key, value in family.dimensions.items()}
    density = _number(family.density, {}, rng, "density")
    heavy = build(Description(name, family.category, 1.0, family.shape, dimensions))
    mass = round(density * float(heavy.mesh.volume), 3)
    if not masses[0] <= mass <= masses[1]:
        raise InputError(f"mass: expected {masses[0]:g} to {masses[1]:g} kg, got {mass:g}")
    description = Description(name, family.category, mass, family.shape, dimensions)
    built = build(description)
    check_solid(built)
    return Drawn(description, family.product, built)


def check_solid(built: GraspObject) -> None:
    """InputError for a surface that is not one closed body, or pieces that do not tile what it encloses."""
    mesh, corners = built.mesh, max(map(len, built.parts))
    if not (mesh.is_watertight and mesh.is_winding_consistent and mesh.body_count == 1):
        raise InputError("dimensions: expected one closed surface, got one that is open or in parts")
    if corners > MOST_CORNERS:
        raise InputError(f"dimensions: expected pieces of {MOST_CORNERS} corners at most, got {corners}")
    tiled = sum(float(ConvexHull(part).volume) for part in built.parts)
    if abs(tiled - mesh.volume) > TILING * mesh.volume:
        raise InputError(f"dimensions: expected pieces that fill {mesh.volume * 1e6:.4g} cm3, got {tiled * 1e6:.4g}")


def _rounded(value: Any, sizes: dict[str, float], rng: np.random.Generator, place: str) -> Any:
    """A dimension with all its numbers drawn, at any depth."""
    if isinstance(value, dict):
        return {key: _rounded(part, sizes, rng, f"{place}.{key}") for key, part in value.items()}
    if isinstance(value, list):
        return [_rounded(part, sizes, rng, place) for part in value]
    return value if isinstance(value, bool) else round(_number(value, sizes, rng, place), DIGITS)


def _number(value: Any, sizes: dict[str, float], rng: np.random.Generator, place: str) -> float:
    """A number as it stands, drawn from a range, and as a share of a size. One draw a number, whatever it is."""
    at = float(rng.random())
    found = _DRAWN.fullmatch(str(value).strip())
    if found is None or not any(found.groups()) or (found["size"] or "") not in {"", *sizes}:
        known = f" of {', '.join(sizes)}" if sizes else ""
        raise InputError(f"{place}: expected a number, a range a-b or a share of a size{known}, got {value}")
    low = float(found["low"] or 1.0)
    high = float(found["high"] or low)
    return (low + at * (high - low)) * (sizes[found["size"]] if found["size"] else 1.0)
