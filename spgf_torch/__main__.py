"""`spgf COMMAND ...`, or `python -m spgf_torch COMMAND ...`: which commands there are, and each of them."""

from __future__ import annotations

import runpy
import sys
from difflib import get_close_matches

from spgf_torch import __version__
from spgf_torch.terminal import patient

COMMANDS = {
    "train": "learn prototypes and grasp affordances: the experiment of the paper, and a model",
    "predict": "ranked grasps for a point cloud, depth images or a mesh: input=FILE",
    "serve": "a model kept warm behind HTTP, on this machine: hand=NAME",
    "view": "frames as they come into a folder, with their grasps, in the browser: view FOLDER hand=NAME",
    "evaluate": "a model's best grasps on scanned meshes, executed in SAPIEN: objects=FOLDER",
    "simulate": "candidate grasps on objects, each tried in SAPIEN: the trial table",
    "generate": "household objects drawn from ranges of sizes, a description each: count=... out=FOLDER",
    "hand": "check and draw a hand, or describe a bare URDF: hand=FILE",
    "judge": "learn a hand's judge of grasp hypotheses, from trials of its own choosing",
    "clutter": "tables full of things, cleared grasp by grasp in SAPIEN: arrangement=packed|pile views=...",
    "pack": "keep a model by a name, in few bytes, with judge, hand and card: model=latest name=NAME",
    "export": "a trial table as a data set in other formats: format=...",
    "report": "Table 1, the figures and one page from runs of train",
    "compare": "descriptors and the learned baseline side by side",
    "baseline": "a network that judges grasps from sensed points, on the same folds",
}


USAGE = "spgf COMMAND [FILE ...] [--setting VALUE | setting=VALUE ...]   (spgf COMMAND --help tells each setting)"


def main(arguments: list[str]) -> int:
    """Run a command, or tell which there are; 2 for anything else that was asked for."""
    if arguments and arguments[0] in COMMANDS:
        sys.argv = [f"spgf {arguments[0]}", *arguments[1:]]
        runpy.run_module(f"spgf_torch.{arguments[0]}", run_name="__main__", alter_sys=True)
        return 0
    with patient():
        return _tell(arguments)


def _tell(arguments: list[str]) -> int:
    """Print what was asked of no command: the version, a script for a shell, the commands."""
    if arguments == ["--version"]:
        print(f"spgf_torch {__version__}")
        return 0
    if arguments[:1] == ["completion"]:
        return _complete(arguments[1:])
    if arguments and arguments not in (["--help"], ["-h"], ["help"]):
        near = get_close_matches(arguments[0], [*COMMANDS, "completion"], 1)
        remedy = f"did you mean {near[0]}?" if near else "spgf --help lists them"
        print(f"spgf: expected a command, got {arguments[0][:200]!r}; {remedy}", file=sys.stderr)
        return 2
    width = max(map(len, COMMANDS))
    print(f"spgf_torch {__version__}: {USAGE}\n")
    for name, words in COMMANDS.items():
        print(f"  {name:{width}}  {words}")
    print(f"  {'completion':{width}}  a script that completes commands and options: completion bash|zsh|fish")
    return 0


def _complete(arguments: list[str]) -> int:
    """Print the script of a shell."""
    from spgf_torch.cli.completion import SHELLS, script

    if len(arguments) != 1 or arguments[0] not in SHELLS:
        got = " ".join(arguments)[:200] or "none"
        print(f"spgf completion: expected one of {', '.join(SHELLS)}; got {got}", file=sys.stderr)
        return 2
    print(script(arguments[0], COMMANDS), end="")
    return 0


def spgf() -> None:
    """The console script: leave with the status of `main`."""
    sys.exit(main(sys.argv[1:]))


if __name__ == "__main__":
    spgf()
