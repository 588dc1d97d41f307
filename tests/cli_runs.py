"""Runs commands as the shell would, in this process."""

from __future__ import annotations

import contextlib
import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tcrdata.cli import main


@dataclass(frozen=True)
class Run:
    """What a command left: exit code, stdout, stderr."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out)


def run(*arguments: object) -> Run:
    out, err = io.StringIO(), io.StringIO()
    with (
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        pytest.raises(SystemExit) as ended,
    ):
        main([str(argument) for argument in arguments])
    assert isinstance(ended.value.code, int)
    return Run(ended.value.code, out.getvalue(), err.getvalue())


def done(*arguments: object) -> Run:
    """Run a command that must succeed."""
    result = run(*arguments)
    assert result.code == 0, result.err
    return result


def refused(*arguments: object) -> str:
    """Run a command that must end with one line on stderr and a non-zero exit; return the line."""
    result = run(*arguments)
    assert result.code != 0
    assert result.out == ""
    assert result.err.startswith("tcrdata: ")
    assert result.err.count("\n") == 1
    assert "Traceback" not in result.err
    assert "unexpected" not in result.err
    return result.err.strip()


def build_command(root: object, store: object, *more: object) -> tuple[object, ...]:
    """A build of a KITTI folder in this process."""
    where = ("--root", root, "--store", store)
    return ("build", "--dataset", "kitti", *where, "--workers", 1, *more)


def status_of(store: Path) -> dict[str, Any]:
    """What `status --json` says."""
    found: dict[str, Any] = done("status", "--store", store, "--json").json
    return found
