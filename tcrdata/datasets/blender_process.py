"""Runs `blender_scene` in a process of its own, so that bpy is never imported by this one."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

from tcrdata.errors import RendererError

PYTHON_VARIABLE = "TCRDATA_BLENDER_PYTHON"
PROGRAM = Path(__file__).with_name("blender_scene.py")
MARK = "tcrdata: "
LAST_LINES = 8
INSTALL = (
    "pip install 'tcrdata[cater]' on Python 3.13; elsewhere 'python3.11 -m venv blender && "
    f"blender/bin/pip install bpy==5.0.1', then {PYTHON_VARIABLE}=blender/bin/python"
)
LIBRARIES = "apt-get install libx11-6 libxrender1 libxfixes3 libxi6 libxkbcommon0 libsm6 libgl1"


def interpreter(given: str = "") -> str:
    """Return the Python that Blender runs in: the one given, the environment's, or this one."""
    return given or os.environ.get(PYTHON_VARIABLE, "") or sys.executable


def bpy_version(python: str) -> str:
    """Return the version of an interpreter's bpy, such as `5.0.1`.

    Raises:
        RendererError: no such interpreter, no bpy in it, or it does not load.
    """
    said = list(_said(python, ["--version"], ""))
    if len(said) != 1:
        raise RendererError(f"{python} did not say which bpy it has; it said {said}")
    return said[0]


def rendered(python: str, job: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Render a job's images; yield each when its file is there, whole.

    Args:
        python: the interpreter.
        job: see `blender_job`.

    Raises:
        RendererError: no such interpreter, or the process ended before the last image was there.
    """
    images = job["images"]
    count = 0
    for said in _said(python, [], json.dumps(job)):
        if said != str(count):
            raise RendererError(f"the Blender process said {said!r} after {count} images")
        yield images[count]
        count += 1
    if count < len(images):
        raise RendererError(f"the Blender process ended after {count} of {len(images)} images")


def _said(python: str, arguments: list[str], stdin: str) -> Iterator[str]:
    """Yield what the process says to tcrdata, line by line; it ends when nobody listens."""
    # Blender's own add-ons must not find tcrdata's modules beside the program.
    command = [python, "-P", str(PROGRAM), *arguments]
    try:
        process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            env=_environment(python),
        )
    except OSError as error:
        raise RendererError(f"{python}: no Python that runs: {error.strerror}") from error
    assert process.stdin is not None
    assert process.stdout is not None
    last: deque[str] = deque(maxlen=LAST_LINES)
    try:
        _send(process.stdin, stdin)
        for line in process.stdout:
            if line.startswith(MARK):
                yield line.removeprefix(MARK).strip()
            elif line.strip():
                last.append(line.strip())
        if process.wait():
            raise RendererError(_failure(python, process.returncode, list(last)))
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def _send(stdin: IO[str], text: str) -> None:
    """Write a text and close; a process that has ended says why on its stdout."""
    try:
        stdin.write(text)
        stdin.close()
    except BrokenPipeError:
        pass


def _environment(python: str) -> dict[str, str]:
    """Return the process's environment: another Python finds no modules of this one's."""
    own = python == sys.executable
    return {
        name: value
        for name, value in os.environ.items()
        if own or name not in ("PYTHONPATH", "PYTHONHOME")
    }


def _failure(python: str, code: int, last: list[str]) -> str:
    """Say in one line why the process ended, and what to do."""
    reason = last[-1] if last else ""
    if "No module named 'bpy'" in reason:
        return f"--renderer blender needs bpy, which {python} does not have: {INSTALL}"
    if "ImportError" in reason:
        return f"bpy of {python} does not load: {reason}; on Debian: {LIBRARIES}"
    how = f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
    said = " | ".join(last) or "nothing"
    return (
        f"the Blender process of {python} ended with {how}; finished images are kept, and the "
        f"same command goes on; its last lines: {said}"
    )
