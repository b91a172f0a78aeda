"""An estimate for all stages of a run, from those that have taken time."""

import re
import threading
import time

import pytest

from spgf_torch import progress
from spgf_torch.progress import ProgressReporter


def test_what_is_left_of_all_stages(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    """Ten seconds a share; what was kept, not needed or not planned takes no part."""
    clock = [0.0]
    monkeypatch.setattr(progress.time, "perf_counter", lambda: clock[0])
    stages = ProgressReporter([("kept", 5.0), ("work", 3.0), ("skipped", 7.0), ("work", 4.0), ("last", 2.0)])

    def run(name: str, seconds: float) -> str:
        with stages.stage(name, 2) as advance:
            for _ in range(2):
                clock[0] += seconds / 2
                advance(1)
        return capsys.readouterr().err

    assert "all stages" not in run("kept", 0.1) and "all stages" not in run("unplanned", 50.0)
    told = run("work", 60.0)  # half of it after 30 s, 1.5 of 3 shares
    assert "about 30 s left, about 290 s of all stages left" in told and "about 260 s of all stages left" in told
    with stages.stage("last", 1) as advance:  # neither what is skipped nor the second work comes any more
        clock[0] += 30
        advance(1)
    assert "all stages" not in capsys.readouterr().err and not stages.plan


def test_a_first_step_that_takes_long_is_no_silence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """Without a terminal, and without a step done: the stage, and how long it has taken; nothing of what is left."""
    monkeypatch.setattr(progress, "EVERY", 0.02)
    said, end = "", time.monotonic() + 20
    with ProgressReporter([("work", 1.0), ("more", 1.0)]).stage("work", 3, "judges") as advance:
        while "\n" not in said and time.monotonic() < end:
            said += capsys.readouterr().err
            time.sleep(0.01)
        advance(3)
    assert re.fullmatch(r"work 0 of 3 judges \d\.\d s", " ".join(said.splitlines()[0].split())), said
    before = threading.active_count()
    with ProgressReporter().stage("quick", 1) as advance:
        advance(1)
    assert threading.active_count() == before and "quick" in capsys.readouterr().err
