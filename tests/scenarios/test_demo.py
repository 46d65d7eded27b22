"""`make demo` behind its Makefile: two processes, a report, and nothing left behind."""

from __future__ import annotations

import importlib
import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

DEMO = Path(__file__).parents[2] / "deploy" / "demo.py"
PATIENCE_S = 180.0

pytestmark = [
    pytest.mark.processes,
    pytest.mark.skipif(not Path("/proc/self/cwd").exists(), reason="looks for processes in /proc"),
]


def left_in(folder: Path) -> list[str]:
    """Command lines of the processes whose working directory is `folder`."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if Path(os.readlink(process / "cwd")) == folder:
                found.append((process / "cmdline").read_text().replace("\0", " "))
        except OSError:
            continue  # gone, or not ours
    return found


def test_ends_with_a_report_although_the_usual_port_is_taken(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            taken.bind(("127.0.0.1", 7447))
            taken.listen()
        except OSError:
            pass  # somebody else has it: as good
        command = [sys.executable, DEMO, "--seconds", "25"]
        done = subprocess.run(command, check=False, cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    assert "Port 7447 is taken" in done.stdout
    assert "gameopt-im serve --map out/demo/four-arm.net.xml --clock lockstep\n" in done.stdout
    report = json.loads((tmp_path / "out/demo/report.json").read_text())
    assert report["duration_s"] == 25.0
    assert report["vehicles"]["crossed"] > 0
    assert not left_in(tmp_path)


def test_ends_on_ctrl_c_and_leaves_no_manager(tmp_path: Path) -> None:
    command = [sys.executable, DEMO, "--seconds", "3600"]
    with subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, process_group=0
    ) as demo:
        assert demo.stdout is not None
        for line in demo.stdout:
            if "serving" in line:
                break
        os.killpg(demo.pid, signal.SIGINT)  # as a terminal does: to the demo and its vehicles
        demo.communicate(timeout=PATIENCE_S)
    assert not left_in(tmp_path)


@pytest.mark.parametrize("what", ["vehicles", "manager"])
def test_what_is_just_being_started_is_ended_too(what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C comes while it is: broken off there, it would go on for good, unheard of by anybody."""
    monkeypatch.syspath_prepend(DEMO.parent)
    demo = importlib.import_module("demo")
    start = subprocess.Popen
    started: list[subprocess.Popen[str]] = []

    def interrupted(_command: object, **options: Any) -> subprocess.Popen[str]:
        started.append(start([sys.executable, "-c", "input()"], **options | {"stdin": subprocess.PIPE}))
        signal.raise_signal(signal.SIGINT)
        return started[0]

    usual = signal.signal(signal.SIGINT, signal.default_int_handler)
    monkeypatch.setattr(demo.subprocess, "Popen", interrupted)
    try:
        if what == "vehicles":
            demo.drive(["gameopt-vehicles"])
        else:
            with pytest.raises(KeyboardInterrupt), demo.serving(["gameopt-im"], tmp_path / "manager.log"):
                pass
        assert started[0].poll() == -signal.SIGTERM
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, usual)
        for each in started:
            each.kill()
            each.communicate()
