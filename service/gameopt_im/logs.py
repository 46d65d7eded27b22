"""Structured logs on stderr: lines to read, or JSON to collect.

As JSON every line is one object with `time`, `level` and `event`, whoever has something to say: libraries that
log as the standard library does, warnings, and what nobody caught, with its traceback as a string in `exception`.
"""

from __future__ import annotations

import logging
import sys
import threading
from types import TracebackType

import structlog

from gameopt_im.options import LogFormat


class Forwarded(logging.Handler):
    """Hands what libraries log to structlog."""

    def emit(self, record: logging.LogRecord) -> None:
        """One record; logging calls this."""
        said = record.getMessage().strip()
        structlog.get_logger().log(record.levelno, said, logger=record.name, exc_info=record.exc_info)


def configure(log_format: LogFormat) -> None:
    """Sets up logging for the process; called once, before anything logs."""
    stream = sys.stderr
    renderer: structlog.typing.Processor
    if log_format == "json":
        renderer = structlog.processors.JSONRenderer()
        _catch_all()
    else:
        renderer = structlog.dev.ConsoleRenderer(colors=stream.isatty(), timestamp_key="time")
    structlog.configure(
        processors=[
            structlog.contextvars.merge_contextvars,
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True, key="time"),
            structlog.processors.StackInfoRenderer(),
            *([structlog.processors.format_exc_info] if log_format == "json" else []),
            renderer,
        ],
        wrapper_class=structlog.make_filtering_bound_logger(logging.INFO),
        logger_factory=structlog.PrintLoggerFactory(stream),
        cache_logger_on_first_use=False,
    )
    logging.basicConfig(handlers=[Forwarded()], level=logging.WARNING)


def _catch_all() -> None:
    """What Python would print by itself, over several lines, is logged."""
    sys.excepthook = _uncaught
    threading.excepthook = lambda raised: _log("uncaught in a thread", raised.exc_value, thread=raised.thread)
    sys.unraisablehook = lambda raised: _log(raised.err_msg or "ignored", raised.exc_value, object=raised.object)
    logging.captureWarnings(True)


def _uncaught(_kind: type[BaseException], error: BaseException, _trace: TracebackType | None) -> None:
    _log("uncaught", error)


def _log(event: str, error: BaseException | None, **about: object) -> None:
    structlog.get_logger().critical(event, exc_info=error, **about)
