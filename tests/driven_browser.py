"""A real browser that tests drive: pages, clicks, keys, pictures, and all that it writes on its console.

It is spoken to in the DevTools protocol over two pipes (--remote-debugging-pipe): nothing else needs to be installed.
"""

from __future__ import annotations

import base64
import json
import os
import select
import subprocess
import time
from pathlib import Path
from typing import Any

from browser import BROWSER

OPTIONS = (
    *("--headless", "--no-sandbox", "--remote-debugging-pipe", "--no-first-run", "--hide-scrollbars"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-quic"),
)
# WebGL in software, as on machines without a graphics card.
SOFTWARE_GL = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
PATIENCE = 60.0  # s that an answer may take on a busy machine


class DrivenBrowser:
    """One process; each page is a tab of its own."""

    def __init__(self, profile: Path, *options: str) -> None:
        (theirs, self._to), (self._from, back) = os.pipe(), os.pipe()
        # The protocol's pipes are the descriptors 3 and 4.
        command = ["bash", "-c", f'exec "$@" 3<&{theirs} 4>&{back}', "bash", str(BROWSER)]
        command += [*OPTIONS, *options, f"--user-data-dir={profile}"]
        self._process = subprocess.Popen(command, pass_fds=(theirs, back), stderr=subprocess.DEVNULL)
        os.close(theirs)
        os.close(back)
        self._buffer, self._number = b"", 0
        self.events: list[dict[str, Any]] = []

    def call(self, method: str, session: str | None = None, **params: Any) -> dict[str, Any]:
        """The result of a command of the protocol; what happened meanwhile is in `events`."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": params}
        if session is not None:
            message["sessionId"] = session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        while (answer := self._message()).get("id") != self._number:
            self.events.append(answer)
        if "error" in answer:
            raise RuntimeError(f"{method}: {answer['error']}")
        result: dict[str, Any] = answer["result"]
        return result

    def _message(self) -> dict[str, Any]:
        end = time.monotonic() + PATIENCE
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._from], [], [], max(0.0, end - time.monotonic()))
            part = os.read(self._from, 1 << 20) if ready else b""
            if not part:
                raise TimeoutError(f"the browser: expected an answer within {PATIENCE:g} s")
            self._buffer += part
        line, _, self._buffer = self._buffer.partition(b"\0")
        message: dict[str, Any] = json.loads(line)
        return message

    def open(
        self, page: Path, size: tuple[int, int] = (1280, 800), dark: bool = False, touch: bool = False, before: str = ""
    ) -> Tab:
        """A new tab with a page, loaded; the script `before` runs in it before its own."""
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        tab = Tab(self, session, target)
        for domain in ("Page", "Runtime", "Log"):
            tab.call(f"{domain}.enable")
        look = {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": touch}
        tab.call("Emulation.setDeviceMetricsOverride", **look)
        tab.call("Emulation.setTouchEmulationEnabled", enabled=touch)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        tab.call("Emulation.setEmulatedMedia", features=[scheme])
        tab.call("Page.addScriptToEvaluateOnNewDocument", source=before)
        tab.call("Page.navigate", url=page.as_uri())
        tab.until("document.readyState === 'complete'")
        return tab

    def close(self) -> None:
        """End the process and wait for it."""
        self._process.terminate()
        self._process.wait(timeout=30)
        os.close(self._to)
        os.close(self._from)


class Tab:
    """One page of a driven browser."""

    def __init__(self, browser: DrivenBrowser, session: str, target: str) -> None:
        self.browser, self.session, self.target = browser, session, target

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        return self.browser.call(method, self.session, **params)

    def run(self, script: str) -> Any:
        """The value of an expression in the page."""
        given = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in given:
            raise RuntimeError(f"{script}: {given['exceptionDetails']}")
        return given["result"].get("value")

    def until(self, script: str) -> None:
        """Wait until an expression is true."""
        end = time.monotonic() + PATIENCE
        while not self.run(script):
            if time.monotonic() > end:
                raise TimeoutError(f"expected within {PATIENCE:g} s: {script}")
            time.sleep(0.05)

    def click(self, selector: str) -> None:
        """A click of the mouse on the middle of an element, which is scrolled into sight."""
        middle = "[b.x + b.width / 2, b.y + b.height / 2]"
        script = f"e.scrollIntoView({{block: 'nearest'}}); const b = e.getBoundingClientRect(); return {middle};"
        box = self.run(f"(() => {{ const e = document.querySelector({json.dumps(selector)}); {script} }})()")
        self.mouse("mousePressed", *box)
        self.mouse("mouseReleased", *box)

    def mouse(self, what: str, x: float, y: float) -> None:
        """An event of the mouse at a place of the window, with the left button where one is pressed."""
        pressed = what != "mouseMoved"
        button = {"button": "left", "clickCount": 1} if pressed else {}
        self.call("Input.dispatchMouseEvent", type=what, x=x, y=y, **button)

    def press(self, key: str) -> None:
        """A key, by its name in the DOM."""
        text = {"text": key} if len(key) == 1 else {}
        self.call("Input.dispatchKeyEvent", type="keyDown", key=key, **text)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key)

    def picture(self, path: Path) -> None:
        """What the window shows, as a PNG file."""
        path.write_bytes(base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"]))

    def wrong(self) -> list[str]:
        """All errors and warnings so far: exceptions, the console's and the browser's own."""
        self.run("0")
        said = []
        for event in self.browser.events:
            if event.get("sessionId") != self.session:
                continue
            method, params = event["method"], event["params"]
            if method == "Runtime.exceptionThrown":
                said.append(json.dumps(params["exceptionDetails"])[:500])
            elif method == "Runtime.consoleAPICalled" and params["type"] in ("error", "warning", "assert"):
                said.append(json.dumps(params["args"])[:500])
            elif method == "Log.entryAdded" and params["entry"]["level"] in ("error", "warning"):
                said.append(params["entry"]["text"])
        return said

    def close(self) -> None:
        self.browser.call("Target.closeTarget", targetId=self.target)
