"""Opens a page in headless Chromium at a phone's or a desk's width."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
SECONDS = 120
# The page tells its errors, its width and what it asked for to the frame that it stands in: a
# window of the browser itself is never as narrow as a phone.
SPY = """<script>
const errors = [];
addEventListener("error", (event) => errors.push(String(event.message || event.target.src)), true);
addEventListener("load", () => parent.postMessage({
  errors, inner: innerWidth, wide: document.documentElement.scrollWidth,
  asked: performance.getEntriesByType("resource").map((entry) => entry.name)
    .filter((name) => !name.startsWith("data:")),
  smallest: Math.min(...[...document.querySelectorAll("p, td, th, dd, span, a, code")]
    .filter((part) => part.textContent.trim() && part.offsetParent)
    .map((part) => parseFloat(getComputedStyle(part).fontSize))),
}, "*"));
</script>"""
FRAME = """<!doctype html><body style="margin:0"><script>
addEventListener("message", (event) => {
  document.body.dataset.told = JSON.stringify(event.data);
});
</script><iframe src="PAGE" style="border:0;width:WIDTHpx;height:HEIGHTpx"></iframe>"""


@dataclass(frozen=True)
class Visit:
    """What a browser saw: script errors, widths in pixels, files asked for, console lines."""

    errors: list[str]
    inner: int
    wide: int
    asked: list[str]
    smallest: float
    console: list[str]
    screenshot: Path


def visit(page: Path, folder: Path, width: int, height: int = 1600) -> Visit:
    """Open a page; skips the test where there is no browser."""
    browser = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if browser is None:
        pytest.skip(f"none of {', '.join(BROWSERS)} is installed")
    spied = folder / "spied.html"
    spied.write_text(page.read_text().replace("<head>", f"<head>{SPY}", 1))
    frame = folder / "frame.html"
    text = FRAME.replace("PAGE", spied.name).replace("WIDTH", str(width))
    frame.write_text(text.replace("HEIGHT", str(height)))
    screenshot = folder / f"{width}.png"
    command = [
        browser, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
        "--enable-logging=stderr", "--virtual-time-budget=10000", f"--user-data-dir={folder}/user",
        f"--window-size={max(width, 500)},{height}",
    ]  # fmt: skip
    seen = [
        subprocess.run(
            [*command, action, frame.as_uri()], capture_output=True, text=True, timeout=SECONDS
        )
        for action in ("--dump-dom", f"--screenshot={screenshot}")
    ]
    found = re.search(r'data-told="([^"]*)"', seen[0].stdout)
    assert found, seen[0].stderr[-2000:]
    console = [line for run in seen for line in run.stderr.splitlines() if "CONSOLE" in line]
    return Visit(**json.loads(html.unescape(found[1])), console=console, screenshot=screenshot)
