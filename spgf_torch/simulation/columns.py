"""Columns of Parquet tables: words and numbers in, tensors out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import torch
from torch import Tensor

from spgf_torch.errors import InputError


def dictionary(codes: Tensor, words: tuple[str, ...]) -> pa.DictionaryArray:
    """A column of words from codes (M,) into them."""
    return pa.DictionaryArray.from_arrays(pa.array(codes.numpy().astype(np.int8)), pa.array(words))


def codes_in(path: Path, content: pa.Table, column: str, words: tuple[str, ...]) -> Tensor:
    """(M,) int64 into `words`, of a column of them. Raises InputError for other words."""
    values = content[column].cast(pa.string())
    codes = pc.index_in(values, pa.array(words, pa.string()))
    if codes.null_count:
        unknown = set(values.to_pylist()) - set(words)
        raise InputError(f"{path}: expected {column} one of {', '.join(words)}; got {min(map(str, unknown))}")
    return torch.from_numpy(codes.to_numpy().astype(np.int64))


def words_of(content: pa.Table, column: str) -> tuple[str, ...]:
    """The words that occur in a column of them, sorted."""
    found = pc.unique(content[column].cast(pa.string())).to_pylist()
    return tuple(sorted(word for word in found if word is not None))


def floats(content: pa.Table, columns: tuple[str, ...]) -> Tensor:
    """(M, columns) float32."""
    return torch.from_numpy(np.column_stack([content[name].to_numpy() for name in columns]).astype(np.float32))
