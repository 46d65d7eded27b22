"""Logs as JSON: whatever happens, every line on stderr is one object."""

from __future__ import annotations

import json
import subprocess
import sys
from datetime import datetime
from typing import Any

import pytest

PROGRAM = r"""
import logging, pathlib, threading, warnings
import structlog
from gameopt_im import logs

def fail():
    raise RuntimeError("first line\nsecond line")

class Broken:
    def __del__(self):
        fail()

logs.configure("json")
structlog.get_logger().warning("of our own\n", vehicle="a\nb", path=pathlib.Path("x"), what=object())
logging.getLogger("library").info("below a warning: not said")
logging.getLogger("library").warning("of %s\n", "a library")
warnings.warn("a warning\nof Python", DeprecationWarning)
try:
    fail()
except RuntimeError:
    structlog.get_logger().exception("caught")
    logging.getLogger("aiohttp.server").exception("caught by a library")
thread = threading.Thread(target=fail)
thread.start()
thread.join()
broken = Broken()
del broken
fail()
"""


@pytest.fixture(scope="module")
def ended() -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-W", "default", "-c", PROGRAM]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def lines(ended: subprocess.CompletedProcess[str]) -> list[dict[str, Any]]:
    return [json.loads(line) for line in ended.stderr.splitlines()]


def test_every_line_is_one_object_with_time_level_and_event(ended: subprocess.CompletedProcess[str]) -> None:
    assert [(line["level"], line["event"].partition(":")[0]) for line in lines(ended)] == [
        ("warning", "of our own\n"),
        ("warning", "of a library"),
        ("warning", "<string>"),
        ("error", "caught"),
        ("error", "caught by a library"),
        ("critical", "uncaught in a thread"),
        ("critical", "ignored"),
        ("critical", "uncaught"),
    ]
    for line in lines(ended):
        assert datetime.fromisoformat(line["time"]).tzinfo is not None


def test_a_traceback_is_part_of_its_line(ended: subprocess.CompletedProcess[str]) -> None:
    told = [line["exception"] for line in lines(ended)[3:]]
    assert len(told) == 5
    for text in told:
        assert text.startswith("Traceback (most recent call last):\n")
        assert "in fail\n" in text
        assert text.endswith("\nRuntimeError: first line\nsecond line")


def test_what_nobody_catches_ends_the_program(ended: subprocess.CompletedProcess[str]) -> None:
    assert (ended.returncode, ended.stdout) == (1, "")
