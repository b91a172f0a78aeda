"""A process that is forked after use works, whatever the number of threads."""

from pathlib import Path

import pytest
from commands import python

CODE = """
import os, signal, sys
import torch
import spgf_torch
from spgf_torch.threads import in_parts
{prepare}

def work():
    a = torch.ones(600, 600) @ torch.ones(600, 600)
    b = torch.arange(3_000_000.0).sin().sum()
    return float(a.sum() + b), list(in_parts(lambda i: i * i, range(20)))

torch.set_num_threads(2)
expected = work()

def child(depth):
    pid = os.fork()
    if pid == 0:
        signal.alarm(30)
        same = abs(work()[0] - expected[0]) < 1 and work()[1] == expected[1]
        if depth:
            same = same and os.waitpid(child(depth - 1), 0)[1] == 0
        os._exit(0 if same else 1)
    return pid

children = [child(1) for _ in range(3)]
print([os.waitpid(pid, 0)[1] for pid in children], torch.get_num_threads(), work() == expected)
"""


@pytest.mark.parametrize("prepare", ["", "torch.set_num_threads(2); torch.ones(9_000_000).sin()"])
def test_a_forked_process_and_its_own_child(prepare: str, tmp_path: Path) -> None:
    done = python("-c", CODE.format(prepare=prepare), cwd=tmp_path)
    assert done.returncode == 0 and done.stdout.split("]")[0] == "[0, 0, 0", (done.stdout, done.stderr[-2000:])
    assert done.stdout.split()[-2] == "2"
