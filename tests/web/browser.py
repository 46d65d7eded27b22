"""A Chromium for the tests of the live page: Playwright's own where it can be had, else the system's.

As a program it installs one where there is none, and says which it is; exit 1 where none can be had.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

NAMES = ("chromium", "chromium-browser", "google-chrome-stable", "google-chrome")
ARGUMENTS = ("--no-sandbox", "--disable-gpu")
"""For root and in containers; the page is our own."""
PATIENCE_S = 300.0


def found(own: str) -> str | None:
    """The browser to use, Playwright's `own` where it is there; None where there is none."""
    return own if Path(own).exists() else next(filter(None, map(shutil.which, NAMES)), None)


def own_path() -> str:
    """Where Playwright would have its own."""
    with sync_playwright() as playwright:
        return playwright.chromium.executable_path


def install() -> None:
    """Playwright's own, or the distribution's where that cannot be fetched and we may."""
    attempts = [[sys.executable, "-m", "playwright", "install", "chromium"]]
    if os.geteuid() == 0 and shutil.which("apt-get"):
        attempts += [["apt-get", "update"], ["apt-get", "install", "--yes", "--no-install-recommends", "chromium"]]
    for attempt in attempts:
        subprocess.run(attempt, check=False, timeout=PATIENCE_S, stdout=sys.stderr)
        if found(own_path()):
            return


def main() -> int:
    """Exit code."""
    if found(own_path()) is None:
        install()
    browser = found(own_path())
    if browser is None:
        sys.stderr.write("no Chromium: `playwright install chromium`, or your system's chromium, would do\n")
        return 1
    sys.stdout.write(f"browser: {browser}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
