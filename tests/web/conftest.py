"""The live page's tests need a browser: they say which one they use."""

from __future__ import annotations

import pytest

pytest.importorskip("playwright", reason="pip install -e '.[dev,web]', or make test-web")

import browser


def pytest_report_header() -> str:
    return f"browser: {browser.found(browser.own_path()) or 'none; make test-web installs one'}"
