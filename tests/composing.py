"""The settings of commands as Hydra composes them, once for all tests that choose the same groups.

Hydra reads every file of conf/ anew for each composition, which takes a third of a second. What only changes values is
applied to a copy, in the way in which Hydra does it at last.
"""

from copy import deepcopy
from functools import cache
from typing import Any

from hydra import compose, initialize_config_dir
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from spgf_torch.cli.command import slug
from spgf_torch.paths import root


def config_of(command: str, *overrides: str) -> DictConfig:
    """What a run of the command gets, without what is Hydra's own."""
    parsed = OverridesParser.create().parse_overrides(list(overrides))
    groups = tuple(override.input_line or "" for override in parsed if not _is_value(override))
    config = deepcopy(_of_groups(command, groups))
    try:
        for override in filter(_is_value, parsed):
            OmegaConf.update(config, override.key_or_group, override.value(), merge=True)
    except OmegaConfBaseException:
        return by_hydra(command, overrides)  # it says what is wrong
    return config


def composed(command: str, *overrides: str) -> Any:
    """The same as plain values."""
    return OmegaConf.to_container(config_of(command, *overrides), resolve=True)


def by_hydra(command: str, overrides: tuple[str, ...]) -> DictConfig:
    OmegaConf.register_new_resolver("slug", slug, replace=True)
    with initialize_config_dir(str(root() / "conf"), version_base="1.3"):
        return compose(command, overrides=list(overrides))


_of_groups = cache(by_hydra)


def _is_value(override: Override) -> bool:
    """Whether it sets a key that is there, and chooses no option of a group."""
    own = override.is_add() or override.is_force_add() or override.is_delete() or override.is_sweep_override()
    return not own and not (root() / "conf" / override.key_or_group.split("@")[0]).is_dir()
