"""`make demo`: a scenario, then manager and vehicles as two processes, and how to run them by hand."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import click

BIN = Path(sys.executable).parent
OUT = Path("out/demo")
FLOW_VEH_H = 6000
PORT = 7447
STOP_S = 5.0
"""A manager that has not ended by then, because it is compiling, is killed."""


@click.command()
@click.option("--seconds", type=click.FloatRange(1.0, 86400.0), default=60.0, metavar="S", help="Simulated seconds.")
def demo(seconds: float) -> None:
    """Run 6,000 veh/h over the four-arm intersection in lock-step; everything it writes is in out/demo."""
    end_as_ctrl_c_does()
    OUT.mkdir(parents=True, exist_ok=True)
    scenario = [
        "gameopt-sumo",
        "scenario",
        "four-arm",
        "--flow",
        FLOW_VEH_H,
        "--duration",
        seconds,
        "--out",
        OUT,
    ]
    subprocess.run(_words(scenario), check=True, stdout=subprocess.DEVNULL)
    endpoint = f"tcp/127.0.0.1:{free_port(PORT)}"
    manager = ["gameopt-im", "serve", "--map", OUT / "four-arm.net.xml", "--clock", "lockstep"]
    vehicles = ["gameopt-vehicles", "--sumo", OUT / "four-arm.sumocfg", "--clock", "lockstep"]
    vehicles += ["--duration", seconds]
    with serving([*manager, "--listen", endpoint], OUT / "manager.log"):
        started = time.monotonic()
        code = drive([*vehicles, "--connect", endpoint, "--report", OUT / "report.json"])
    click.echo(f"The run took {time.monotonic() - started:.0f} s.")
    if code == 0:
        _explain(scenario, manager, vehicles)
    sys.exit(code)


def end_as_ctrl_c_does() -> None:
    """Whatever signal ends the script, what it has started is ended too."""
    for ending in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(ending, signal.default_int_handler)


@contextmanager
def deferred() -> Iterator[Callable[[], None]]:
    """Defers whatever signal ends the script until what this gives is called: then what has come is raised.

    A start that is broken off halfway leaves a process that nobody ends.
    """
    came: list[int] = []
    endings = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    usual = {each: signal.signal(each, lambda number, _: came.append(number)) for each in endings}

    def release() -> None:
        for each, handler in usual.items():
            signal.signal(each, handler)
        while came:
            signal.raise_signal(came.pop())

    try:
        yield release
    finally:
        release()


def free_port(usual: int) -> int:
    """The usual port, or any free one if that is taken."""
    for port in (usual, 0):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            found: int = probe.getsockname()[1]
            if found != usual:
                click.echo(f"Port {usual} is taken; the demo uses {found}.")
            return found
    raise click.ClickException("no free port on 127.0.0.1")


@contextmanager
def serving(manager: list[object], log_file: Path) -> Iterator[None]:
    """The manager, from the moment it serves until it has ended. Its log goes to `log_file`."""
    with deferred() as release:
        process = subprocess.Popen(
            _words([*manager, "--log-format", "json"]),
            stdin=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            process_group=0,  # Ctrl-C is for the vehicles first: they still need their manager
        )
        assert process.stderr is not None
        try:
            release()
            with log_file.open("w") as log:
                _await_serving(process.stderr, log)
                rest = threading.Thread(target=log.writelines, args=[process.stderr])
                rest.start()
                try:
                    yield
                finally:
                    _stop(process)
                    rest.join()
        finally:
            _stop(process)


def _await_serving(lines: IO[str], log: IO[str]) -> None:
    """Show what the manager says until it serves."""
    for line in lines:
        log.write(line)
        try:
            event = json.loads(line)["event"]
        except (ValueError, KeyError):
            event = line.strip()
        click.echo(f"manager: {event}")
        if event == "serving":
            return
    raise click.ClickException("the manager did not start")


def _stop(process: subprocess.Popen[str]) -> None:
    process.terminate()
    try:
        process.wait(STOP_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def drive(vehicles: list[object]) -> int:
    """Run the vehicles to their end; interrupted, they finish their step and still report."""
    with deferred() as release:
        process = subprocess.Popen(_words(vehicles))
        while True:
            try:
                release()
                return process.wait()
            except KeyboardInterrupt:
                process.terminate()


def _explain(*commands: list[object]) -> None:
    """Say how to do by hand what the demo did."""
    folder = Path(os.path.relpath(BIN))
    scenario, manager, vehicles = (" ".join(_words(command, folder)) for command in commands)
    click.echo(
        f"""
Report: {OUT / "report.json"}, the manager's log: {OUT / "manager.log"}

By hand, the scenario once, then each command in a terminal of its own:
  {scenario}
  {manager}
  {vehicles}
At wall-clock speed: the same without `--clock lockstep` in both. Try --help for the rest.
"""
    )


def _words(command: list[object], folder: Path = BIN) -> list[str]:
    """A command line, with the command found in `folder`."""
    name, *rest = command
    return [
        str(folder / str(name)),
        *(f"{word:g}" if isinstance(word, float) else str(word) for word in rest),
    ]


if __name__ == "__main__":
    demo()
