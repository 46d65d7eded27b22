"""How much the property tests try, what no test may leave behind, and which tests may run side by side."""

import logging
import signal
import sys
import threading
from collections.abc import Iterator

import pytest
import structlog
from hypothesis import settings

# The gate has to say the same of the same commit; searching for new counterexamples is its own command.
settings.register_profile("gate", derandomize=True, deadline=None)
settings.register_profile("explore", max_examples=2000, deadline=None, print_blob=True)
settings.load_profile("gate")

# A shell that runs the tests in the background has them ignore Ctrl-C, and so would all that they start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """With `-n 2 --dist loadgroup` a file stays together, and the tests of several processes follow each other.

    Two of those at once would want four processors.
    """
    for item in items:
        group = item.path.name
        if item.get_closest_marker("processes"):
            item.add_marker(pytest.mark.slow)
            group = "processes"
        item.add_marker(pytest.mark.xdist_group(group))


@pytest.fixture(autouse=True)
def logs_as_they_were(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A command that a test runs in this process logs to the test's own stderr, which is closed when it ends."""
    for hook in (sys, "excepthook"), (sys, "unraisablehook"), (threading, "excepthook"):
        monkeypatch.setattr(*hook, getattr(*hook))
    yield
    structlog.reset_defaults()
    logging.captureWarnings(False)
