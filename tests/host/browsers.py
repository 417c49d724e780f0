# SPDX-License-Identifier: Apache-2.0
"""A page in a headless browser, for the tests of pages."""

from __future__ import annotations

import json
import os
import select
import shlex
import shutil
import subprocess
import time
from base64 import b64decode
from pathlib import Path
from typing import Any

import pytest

_PROBE = """({
  pictures: [...document.images].map(i => [i.complete, i.naturalWidth, i.clientWidth, i.alt.length]),
  requests: performance.getEntriesByType("resource").filter(r => !r.name.startsWith("data:")).map(r => r.name),
  overflow: document.documentElement.scrollWidth - innerWidth,
})"""


def browser() -> str:
    """Chromium; the test is skipped without one."""
    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if found is None:
        reason = "no Chromium to open the report with; get it by: apt-get install chromium"
        if os.environ.get("CI"):
            pytest.fail(reason)
        pytest.skip(reason)
    return found


def options_of(folder: Path, width: int) -> list[str]:
    """Options of a headless browser with its own profile, which asks nobody for anything."""
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"]
    options += ["--disable-background-networking", "--disable-component-update", "--disable-sync", "--hide-scrollbars"]
    return [*options, f"--user-data-dir={folder / 'profile'}", f"--window-size={width},900"]


class Tab:
    """A page in a headless browser that the test can ask, by the DevTools protocol over a pipe."""

    def __init__(self, folder: Path, width: int = 1280) -> None:
        to_browser, self._send = os.pipe()
        self._receive, from_browser = os.pipe()
        command = [browser(), *options_of(folder, width), "--remote-debugging-pipe"]
        shell = f"exec {shlex.join(command)} 3<&{to_browser} 4>&{from_browser}"
        self._process = subprocess.Popen(
            ["bash", "-c", shell], pass_fds=(to_browser, from_browser), stderr=subprocess.DEVNULL
        )
        os.close(to_browser)
        os.close(from_browser)
        self.pid = self._process.pid
        self._left, self._count, self._session = b"", 0, ""
        self.log: list[str] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False)

    def __enter__(self) -> Tab:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self._send)
        os.close(self._receive)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The answer of a method of the protocol."""
        self._count += 1
        message: dict[str, Any] = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._send, json.dumps(message).encode() + b"\0")
        end_s = time.monotonic() + 60.0
        while True:
            while b"\0" not in self._left:
                left_s = max(0.0, end_s - time.monotonic())
                assert select.select([self._receive], [], [], left_s)[0], f"{method}: silent"
                part = os.read(self._receive, 1 << 16)
                assert part, f"{method}: the browser has ended"
                self._left += part
            text, _, self._left = self._left.partition(b"\0")
            answer = json.loads(text)
            if answer.get("id") == self._count:
                assert "error" not in answer, answer
                return answer["result"]
            if answer.get("method") in ("Runtime.exceptionThrown", "Log.entryAdded", "Runtime.consoleAPICalled"):
                self.log.append(json.dumps(answer["params"]))

    def open(self, address: str) -> None:
        """Go to an address."""
        self.call("Page.navigate", url=address)

    def value(self, expression: str) -> Any:
        """The value of an expression in JavaScript; a promise is waited for."""
        found = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def wait(self, expression: str, timeout_s: float = 60.0) -> Any:
        """The value of an expression as soon as it is true."""
        end_s = time.monotonic() + timeout_s
        while not (value := self.value(expression)):
            assert time.monotonic() < end_s, f"{expression} is {value!r} after {timeout_s:g} s; {self.log}"
            self.value("new Promise(done => setTimeout(done, 50))")
        return value

    def picture(self, file: Path) -> None:
        """Save what the page looks like as PNG."""
        file.write_bytes(b64decode(self.call("Page.captureScreenshot")["data"]))


def problems_of(page: str, folder: Path, width: int, pictures: int) -> list[str]:
    """What is wrong with `page` in a browser of that `width`: errors, requests, pictures that are not shown."""
    (folder / "probed.html").write_text(page)
    with Tab(folder, width) as tab:
        tab.open((folder / "probed.html").as_uri())
        tab.wait("document.readyState === 'complete' && location.protocol === 'file:'")
        probe = tab.value(_PROBE)
        problems = list(tab.log)
    problems += [f"it asks for {request}" for request in probe["requests"]]
    if len(probe["pictures"]) != pictures:
        problems.append(f"{len(probe['pictures'])} pictures in place of {pictures}")
    problems += [
        f"picture {i}: complete {complete}, {own} px drawn {shown} px wide, text of {alt} characters"
        for i, (complete, own, shown, alt) in enumerate(probe["pictures"])
        if not complete or own <= 100 or shown <= 250 or alt <= 20
    ]
    if probe["overflow"] > 0:
        problems.append(f"it is {probe['overflow']} px wider than the window")
    return problems
