"""The YAML header of cards, which the Hugging Face Hub reads: what a folder shows there, and by what it is found."""

from __future__ import annotations

import re
from typing import Any

import yaml

# The Hub's names of the licences that data of grasps come under; for any other it wants `other` and a name.
_LICENCES = [
    "apache-2.0",
    "bsd-2-clause",
    "bsd-3-clause",
    "cc-by-4.0",
    "cc-by-nc-4.0",
    "cc-by-nc-sa-4.0",
    "cc-by-sa-4.0",
    "cc0-1.0",
    "gpl-3.0",
    "mit",
]
TAGS = ("robotics", "grasping", "point-cloud", "spgf_torch")


def card_header(*tags: str, licence: str | None = None, **fields: Any) -> str:
    """The header with its closing line; `fields` follow licence and tags in their order.

    Args:
        tags: beside `TAGS`, such as the hand. licence: as its SPDX name, or in words; None: not stated.

    >>> print(card_header("panda", licence="MIT", pipeline_tag="robotics"), end="")
    ---
    license: mit
    tags: [robotics, grasping, point-cloud, spgf_torch, panda]
    pipeline_tag: robotics
    ---
    """
    known: dict[str, Any] = {}
    if licence is not None and licence.lower() in _LICENCES:
        known["license"] = licence.lower()
    elif licence is not None:
        known |= {"license": "other", "license_name": re.sub(r"[^a-z0-9.]+", "-", licence.lower()).strip("-")}
    values = {**known, "tags": [*TAGS, *tags], **fields}
    return (
        f"---\n{yaml.safe_dump(values, sort_keys=False, default_flow_style=None, allow_unicode=True, width=200)}---\n"
    )
