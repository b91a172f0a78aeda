"""Imports of other packages' imports deferred until their contents are used."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType


class _Deferred(ModuleType):
    """A placeholder of a module, which is imported when its first attribute is used."""

    def __getattr__(self, name: str) -> object:
        if name.startswith("__"):  # the import system looks for these
            raise AttributeError(name)
        return getattr(importlib.import_module(self.__name__), name)


@contextmanager
def deferred(package: str, *submodules: str) -> Iterator[None]:
    """Within the block, importing a package that is not loaded yet, or one of its submodules, loads nothing.

    What was bound in the block to the package or to a submodule works as it would otherwise: the real module is loaded
    at its first use, after the block.

    Args:
        package: such as `matplotlib`. submodules: such as `pyplot`, those that are imported in the block.

    >>> import sys
    >>> with deferred("pydoc_data", "topics"):
    ...     from pydoc_data import topics
    >>> "pydoc_data.topics" in sys.modules
    False
    >>> "assert" in topics.topics
    True
    """
    if package in sys.modules:
        yield
        return
    parent = _Deferred(package)
    children = {f"{package}.{name}": _Deferred(f"{package}.{name}") for name in submodules}
    for name in submodules:
        setattr(parent, name, children[f"{package}.{name}"])
    sys.modules.update({package: parent, **children})
    try:
        yield
    finally:
        for name in (package, *children):
            sys.modules.pop(name, None)
