"""`python -m spgf_torch`: which commands there are."""

from __future__ import annotations

import sys

from spgf_torch import __version__
from spgf_torch.terminal import patient

COMMANDS = {
    "train": "learn prototypes and grasp affordances: the experiment of the paper, and a model",
    "predict": "ranked grasps for a point cloud, depth images or a mesh: input=FILE",
    "evaluate": "a model's best grasps on scanned meshes, executed in SAPIEN: objects=FOLDER",
    "simulate": "candidate grasps on objects, each tried in SAPIEN: the trial table",
    "generate": "household objects drawn from ranges of sizes, a description each: count=... out=FOLDER",
    "hand": "check and draw a hand, or describe a bare URDF: hand=FILE",
    "judge": "learn a hand's judge of grasp hypotheses, from trials of its own choosing",
    "clutter": "tables full of things, cleared grasp by grasp in SAPIEN: arrangement=packed|pile views=...",
    "export": "a trial table as a data set in other formats: format=...",
    "report": "Table 1, the figures and one page from runs of train",
    "compare": "descriptors and the learned baseline side by side",
    "baseline": "a network that judges grasps from sensed points, on the same folds",
}


def main(arguments: list[str]) -> int:
    """Print the commands, or the version; 2 for anything else that was asked for."""
    if arguments == ["--version"]:
        print(f"spgf_torch {__version__}")
        return 0
    if arguments and arguments not in (["--help"], ["-h"]):
        meant = [word for word in arguments if word in COMMANDS]
        remedy = f"python -m spgf_torch.{meant[0]}" if meant else "python -m spgf_torch lists the commands"
        print(f"spgf_torch: {arguments[0][:200]!r}: expected no arguments; {remedy}", file=sys.stderr)
        return 2
    width = max(map(len, COMMANDS))
    print(
        f"spgf_torch {__version__}: python -m spgf_torch.COMMAND key=value ...   (--help shows a command's settings)\n"
    )
    for name, words in COMMANDS.items():
        print(f"  {name:{width}}  {words}")
    return 0


if __name__ == "__main__":
    with patient():
        status = main(sys.argv[1:])
    sys.exit(status)
