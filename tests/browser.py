"""A real browser that opens a page: what it writes on its console, and a picture."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
QUIET = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--use-gl=angle", "--use-angle=swiftshader"),
    *("--enable-unsafe-swiftshader", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync", "--enable-logging=stderr", "--timeout=30000"),
)

needs_browser = pytest.mark.skipif(BROWSER is None, reason="no chromium, chromium-browser or google-chrome here")


def opened(page: Path, picture: Path, *options: str, size: tuple[int, int] = (1000, 900)) -> list[str]:
    """The lines of the console; the picture of the window is written. No virtual time: with WebGL drawn in software,
    Chromium's now and then stands still.
    """
    profile = picture.with_name(f"{picture.stem}-profile")
    kept = (f"--user-data-dir={profile}", f"--screenshot={picture}", f"--window-size={size[0]},{size[1]}")
    command = [str(BROWSER), *QUIET, *kept, *options, page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=100)
    assert picture.exists(), done.stderr
    return [line for line in done.stderr.splitlines() if "CONSOLE" in line]
