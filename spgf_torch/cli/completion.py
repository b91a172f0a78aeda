"""`spgf completion bash|zsh|fish`: a script that completes commands, options and names of conf/, elsewhere files."""

from __future__ import annotations

import shlex
from collections.abc import Mapping

from spgf_torch.cli.setting_comments import read_settings
from spgf_torch.paths import root

SHELLS = ("bash", "zsh", "fish")
# Options that every command has; what they do is in cli/help_text.py.
COMMON = ("--help", "--version", "--json", "--out", "--multirun", "--cfg")


def script(shell: str, commands: Mapping[str, str]) -> str:
    """What the shell shall read: `commands` are names with what they do."""
    if shell == "fish":
        return _fish(commands)
    return _bash(commands) if shell == "bash" else _ZSH + _bash(commands)


def options(command: str) -> list[str]:
    """Each option of a command: its settings, those of its groups, and the common ones."""
    own = read_settings(root() / "conf" / f"{command}.yaml")
    names = [key.name for key in own.keys]
    for group, option in own.groups.items():
        bare = group.split("@")[0]
        if not group.endswith("@_here_"):
            names.append(bare)
        if bare != "hand":  # each hand has keys of its own
            prefix = "" if group.endswith("@_here_") else f"{bare}."
            names += [prefix + key.name for key in read_settings(root() / "conf" / bare / f"{option}.yaml").keys]
    hand = ["hand"] if command == "predict" else []
    return sorted({f"--{name}" for name in [*names, *hand]} | set(COMMON))


def choices() -> dict[str, list[str]]:
    """Groups of conf/ with the names of their options."""
    folders = [path for path in sorted((root() / "conf").iterdir()) if path.is_dir() and path.name != "hydra"]
    return {folder.name: sorted(path.stem for path in folder.glob("*.yaml")) for folder in folders}


# zsh runs bash's script; with compinit off, as in a script, it is begun first.
_ZSH = """#compdef spgf
(( $+functions[compdef] )) || { autoload -Uz compinit && compinit -u }
autoload -Uz bashcompinit && bashcompinit
"""


def _bash(commands: Mapping[str, str]) -> str:
    first = " ".join([*commands, "completion", "--help", "--version"])
    named = [f'    --{group}) _spgf_of "{" ".join(names)}"; return ;;' for group, names in choices().items()]
    cases = [f'    {name}) _spgf_of "{" ".join(options(name))}" ;;' for name in commands]
    return "\n".join(
        [
            '_spgf_of() { COMPREPLY=($(compgen -W "$1" -- "${COMP_WORDS[COMP_CWORD]}")); }',
            "_spgf() {",
            '  local word="${COMP_WORDS[COMP_CWORD]}"',
            "  COMPREPLY=()",
            f'  if [ "$COMP_CWORD" -eq 1 ]; then _spgf_of "{first}"; return; fi',
            '  case "${COMP_WORDS[COMP_CWORD-1]}" in',
            f'    completion) _spgf_of "{" ".join(SHELLS)}"; return ;;',
            *named,
            "  esac",
            '  case "$word" in -*) ;; *) return ;; esac',
            '  case "${COMP_WORDS[1]}" in',
            *cases,
            "  esac",
            "}",
            "complete -o default -F _spgf spgf",
            "",
        ]
    )


def _fish(commands: Mapping[str, str]) -> str:
    lines = [
        f"complete -c spgf -n __fish_use_subcommand -f -a {name} -d {shlex.quote(words)}"
        for name, words in {**commands, "completion": "a script that completes in bash, zsh or fish"}.items()
    ]
    lines.append(f"complete -c spgf -n '__fish_seen_subcommand_from completion' -f -a '{' '.join(SHELLS)}'")
    named = choices()
    for name in commands:
        for option in options(name):
            bare = option.removeprefix("--")
            values = f" -x -a '{' '.join(named[bare])}'" if bare in named else ""
            lines.append(f"complete -c spgf -n '__fish_seen_subcommand_from {name}' -l {bare}{values}")
    return "\n".join([*lines, ""])
