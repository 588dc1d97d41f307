"""A command `tcrdata` that starts at once: forked from a process that has imported what it needs.

What the command does, prints and returns is its own. Scripts of many commands then take the time of
what they do, not of as many starts; that the command starts by itself is shown elsewhere.
"""

from __future__ import annotations

import json
import os
import socket
import stat
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

IMPORTED = (
    "matplotlib.pyplot", "pandas", "polars", "pyarrow.dataset", "scipy.optimize", "tcrdata.console",
    "tcrdata.datasets.demo", "tcrdata.datasets.kitti", "tcrdata.evaluation.scoring",
    "tcrdata.evidence.preloading", "tcrdata.pipeline", "tcrdata.rules.judging",
    "tcrdata.track_runs", "tcrdata.views.scene_picture",
)  # fmt: skip
CLIENT = """#!{python} -IS
import array, json, os, socket, sys
with socket.socket(socket.AF_UNIX) as server:
    server.connect({address!r})
    asked = json.dumps([sys.argv[1:], os.getcwd(), dict(os.environ)]).encode()
    streams = array.array("i", [0, 1, 2])
    server.sendmsg([len(asked).to_bytes(4)], [(socket.SOL_SOCKET, socket.SCM_RIGHTS, streams)])
    server.sendall(asked)
    code = server.recv(1)
os._exit(code[0] if code else 1)
"""


@contextmanager
def forked_commands(folder: Path) -> Iterator[str]:
    """Serve commands until the end of the context; yields a `PATH` on which `tcrdata` is one."""
    address = str(folder / "socket")
    command = folder / "tcrdata"
    command.write_text(CLIENT.format(python=sys.executable, address=address))
    command.chmod(command.stat().st_mode | stat.S_IXUSR)
    path = [str(folder), str(Path(sys.executable).parent), os.environ["PATH"]]
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(address)
        listening.listen()
        number = listening.fileno()
        server = subprocess.Popen([sys.executable, __file__, str(number)], pass_fds=[number])
    try:
        yield os.pathsep.join(path)
    finally:
        server.kill()
        server.wait()


def run_forking(
    arguments: list[str], commands: Path, cwd: Path, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run a program in which every `tcrdata` is a forked one, and return what it said.

    Args:
        arguments: the program's.
        commands: folder for the command; made here.
        cwd: where it runs.
        environment: what it finds beside this process's own.
    """
    commands.mkdir()
    with forked_commands(commands) as path:
        return subprocess.run(
            arguments,
            cwd=cwd,
            env={**os.environ, "PATH": path, **environment},
            capture_output=True,
            text=True,
            timeout=500,
        )


def serve(listening: socket.socket) -> None:
    """Fork for each client; what is forked answers it and is over."""
    import importlib

    for name in IMPORTED:
        importlib.import_module(name)
    while True:
        client, _ = listening.accept()
        if not os.fork():
            listening.close()
            client.send(bytes([answered(client)]))
            os._exit(0)
        client.close()
        with suppress(ChildProcessError):
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass


def answered(client: socket.socket) -> int:
    """Run the command that a client asks for, in its place; return the code that it exits with."""
    from tcrdata.__main__ import command

    head, streams, _, _ = socket.recv_fds(client, 4, 3)
    text = b""
    while len(text) < int.from_bytes(head):
        text += client.recv(1 << 16)
    arguments, folder, environment = json.loads(text)
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
        os.close(stream)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    sys.argv[1:] = arguments
    code = 1
    try:
        command()
    except SystemExit as ended:
        code = int(ended.code or 0)
    # A command whose reader has gone has closed them.
    with suppress(OSError, ValueError):
        sys.stdout.flush()
    return code


if __name__ == "__main__":
    serve(socket.socket(fileno=int(sys.argv[1])))
