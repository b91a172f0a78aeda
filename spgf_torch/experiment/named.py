"""What learning knows of an object beside its shape and its grasps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol


class Identity(Protocol):
    """What has a name, a class (one of `objects.config.CLASSES`) and a digest: bodies, views, and what names them."""

    @property
    def name(self) -> str: ...

    @property
    def category(self) -> str: ...

    @property
    def digest(self) -> str: ...


class Named(NamedTuple):
    """That alone."""

    name: str
    category: str
    digest: str


def named(objects: Sequence[Identity]) -> list[Named]:
    """Of each object that alone."""
    return [Named(obj.name, obj.category, obj.digest) for obj in objects]
