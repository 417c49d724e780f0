# SPDX-License-Identifier: Apache-2.0
"""A page in a headless browser, for the tests of pages."""

from __future__ import annotations

import html
import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

_PROBE = """<script>addEventListener("load", () => {
  const images = [...document.images];
  document.body.dataset.probe = JSON.stringify({
    pictures: images.map(i => [i.complete, i.naturalWidth, i.clientWidth, i.alt.length]),
    requests: performance.getEntriesByType("resource").filter(r => !r.name.startsWith("data:")).map(r => r.name),
    overflow: document.documentElement.scrollWidth - innerWidth,
  });
});</script></body>"""


def browser() -> str:
    """Chromium; the test is skipped without one."""
    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if found is None:
        reason = "no Chromium to open the report with; get it by: apt-get install chromium"
        if os.environ.get("CI"):
            pytest.fail(reason)
        pytest.skip(reason)
    return found


def problems_of(page: str, folder: Path, width: int, pictures: int) -> list[str]:
    """What is wrong with `page` in a browser of that `width`: errors, requests, pictures that are not shown."""
    (folder / "probed.html").write_text(page.replace("</body>", _PROBE))
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"]
    options += ["--disable-background-networking", "--disable-component-update", "--disable-sync", "--hide-scrollbars"]
    options += [f"--user-data-dir={folder / 'profile'}", f"--window-size={width},900", "--enable-logging=stderr"]
    command = [browser(), *options, "--dump-dom", (folder / "probed.html").as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    found = re.search(r'data-probe="([^"]*)"', done.stdout)
    if found is None:
        return [f"the page did not load: {done.stderr}"]
    probe = json.loads(html.unescape(found[1]))
    problems = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
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
