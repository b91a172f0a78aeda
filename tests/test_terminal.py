"""Readers that leave, streams without room, poor alphabets, signals: one line, the right status, the work is kept."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from commands import ROOT, in_turn, python

from spgf_torch import __version__

TOY = """
import sys, time
from pathlib import Path
from spgf_torch.cli.command import run_command
from spgf_torch.reporting.config import ReportConfig
from spgf_torch.progress import console, show

def run(config: ReportConfig, folder: Path) -> None:
    for i in range(2000):
        show(f"line {i} of what is said")
        console.print(f"progress {i}")
        print("plain", i)
    (folder / "results.txt").write_text("done") if config.seed == 0 else None
    if config.seed:
        print("started", flush=True)
        time.sleep(60)
    show("the last line: größe 測 [/bold]")

if __name__ == "__main__":
    run_command("report", ReportConfig, run)
"""


@pytest.fixture
def toy(tmp_path: Path) -> Path:
    (tmp_path / "toy.py").write_text(TOY)
    return tmp_path


@pytest.fixture
def brief(tmp_path: Path) -> Path:
    """The same with less to say: no pipe is full."""
    (tmp_path / "toy.py").write_text(TOY.replace("range(2000)", "range(20)"))
    return tmp_path


def shell(line: str, cwd: Path) -> subprocess.CompletedProcess:
    """`line` in bash, where `toy` is the command; the status is the command's, not that of what reads it."""
    script = f'set -o pipefail; toy() {{ {sys.executable} toy.py "$@"; }}; {line}'
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(["bash", "-c", script], cwd=cwd, env=environment, capture_output=True, text=True, timeout=100)


def finished(cwd: Path) -> bool:
    """The run is whole and `latest` points at it."""
    return (cwd / "outputs/report/latest/results.txt").read_text() == "done"


@pytest.mark.parametrize("line", ["toy 2>e | head -3", "toy 2>e | true", "toy 2>&1 | head -1", "toy >&- 2>&-"])
def test_a_reader_that_leaves_ends_no_work(line: str, toy: Path) -> None:
    done = shell(line, toy)
    assert done.returncode == 0 and finished(toy)
    said = (toy / "e").read_text() if (toy / "e").exists() else done.stderr
    assert "Traceback" not in said and "Broken" not in said


def test_no_room_on_stdout_is_told_as_such(toy: Path) -> None:
    done = shell("toy >/dev/full 2>e", toy)
    last = (toy / "e").read_text().splitlines()[-1]
    assert done.returncode == 1 and finished(toy)
    assert last == "report: stdout: expected room to write, got No space left on device; results are kept"
    done = shell("toy 2>/dev/full | tail -1", toy)
    assert done.returncode == 0 and "the last line" in done.stdout


# A run that comes to its end, and one with the words of the command line.
TWICE = """
import runpy, sys
for words in ([], sys.argv[1:]):
    sys.argv = ["toy.py", *words]
    runpy.run_path("toy.py", run_name="__main__")
"""


@pytest.mark.parametrize("variables", [{"PYTHONIOENCODING": "ascii"}, {"LC_ALL": "C", "PYTHONUTF8": "0"}])
def test_an_alphabet_that_lacks_letters(variables: dict[str, str], brief: Path) -> None:
    done = python("-c", TWICE, "runs=größe", "nosuch=測", cwd=brief, **variables, PYTHONCOERCECLOCALE="0")
    assert done.returncode == 2 and finished(brief)
    assert done.stdout.splitlines()[-1].isascii() and done.stdout.endswith("[/bold]\n")
    assert [line.split(":")[0] for line in done.stderr.splitlines() if not line.startswith("progress")] == ["report"]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_signal_ends_a_run_in_order(number: int, brief: Path) -> None:
    """Nothing was finished: no folder is left."""
    command = [sys.executable, "toy.py", "seed=1"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    # A shell's background job ignores SIGINT, nohup SIGHUP, and what they start inherits that.
    before = signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)
    with subprocess.Popen(
        command, cwd=brief, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        signal.signal(number, before)
        assert process.stdout is not None and process.stderr is not None
        while not process.stdout.readline().startswith(b"started"):
            if process.poll() is not None:
                raise AssertionError(process.stderr.read())
        time.sleep(0.2)
        process.send_signal(number)
        said = process.stderr.read().decode().splitlines()
    assert process.returncode == 128 + number
    told = "interrupted" if number == signal.SIGINT else f"ended by {signal.Signals(number).name}"
    assert said[-1] == f"report: {told}" and said[-2].startswith("progress")
    assert not list((brief / "outputs/report").glob("2*"))


def test_a_signal_within_the_import_of_a_compiled_module_ends_in_one_line(toy: Path) -> None:
    """Such a module makes an ImportError of whatever is raised in its initialization, as SAPIEN's does."""
    raised = """    try:
        signal.raise_signal(signal.SIGTERM)
    except BaseException as error:
        raise ImportError("initialization failed") from error
"""
    text = TOY.replace("import sys, time", "import signal, sys, time")
    text = text.replace("    for i in range(2000):", raised + "    for i in []:")
    (toy / "toy.py").write_text(text)
    done = python("toy.py", cwd=toy)
    assert (done.returncode, done.stderr) == (143, "report: ended by SIGTERM\n")


def test_the_commands_and_the_version(tmp_path: Path) -> None:
    lines = (["spgf_torch"], ["spgf_torch", "--version"], ["spgf_torch.predict", "--version"])
    listed, *told, wrong = in_turn(*lines, ["spgf_torch", "predcit", "input=x"], cwd=tmp_path)
    assert listed.returncode == 0 and all(f"\n  {name}" in listed.stdout for name in ("predict", "train", "baseline"))
    assert [done.stdout for done in told] == 2 * [f"spgf_torch {__version__}\n"]
    assert wrong.returncode == 2 and wrong.stderr == "spgf: expected a command, got 'predcit'; did you mean predict?\n"


def test_every_command_is_listed() -> None:
    from spgf_torch.__main__ import COMMANDS

    assert set(COMMANDS) == {path.stem for path in (ROOT / "conf").glob("*.yaml")} - {"command"}
