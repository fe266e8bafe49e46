"""Structured log on standard output: JSON lines, or readable text on a terminal."""

from __future__ import annotations

import logging
import os
import sys
import threading
from collections.abc import Callable, Mapping
from typing import Any, TextIO, cast

import msgspec
import structlog
from structlog.typing import EventDict, Processor, WrappedLogger

from services.runtime.host_config import LogConfig

Logger = structlog.typing.FilteringBoundLogger


class LogStream:
    """A stream whose loss (its reader gone, its disk full) costs lines, never the service."""

    def __init__(self, stream: TextIO, on_lost: Callable[[], object] | None = None) -> None:
        """Write to `stream`; `on_lost` is called once, when its reader has gone."""
        self._stream = stream
        self._on_lost = on_lost

    def write(self, text: str) -> int:
        """Write if that is possible."""
        return self._attempt(lambda: self._stream.write(text))

    def flush(self) -> None:
        """Flush if that is possible."""
        self._attempt(self._stream.flush)

    def _attempt(self, act: Callable[[], int | None]) -> int:
        try:
            return act() or 0
        except BrokenPipeError:
            on_lost, self._on_lost = self._on_lost, None
            if on_lost is not None:
                on_lost()
        except (OSError, ValueError):  # disk full, terminal gone, closed
            pass
        return 0


def wants_json(config: LogConfig, stream: TextIO) -> bool:
    """True when lines are to be JSON."""
    return config.format == "json" or (config.format == "auto" and not stream.isatty())


def wants_colour(environment: Mapping[str, str], stream: TextIO) -> bool:
    """True when text may carry colours (NO_COLOR and FORCE_COLOR are honoured)."""
    if environment.get("NO_COLOR"):
        return False
    return bool(environment.get("FORCE_COLOR")) or stream.isatty()


def configure(
    config: LogConfig,
    stream: TextIO,
    *,
    colour: bool = False,
    on_lost: Callable[[], object] | None = None,
    **bound: str,
) -> Logger:
    """Set up the log of this process and return its logger; `bound` fields stand in every line.

    `on_lost` is called once when the reader of the stream has gone; the process goes on.

    What libraries log or warn, and what ends a thread, goes the same way, so that JSON lines
    stay JSON lines.
    """
    shared: list[Processor] = [
        structlog.contextvars.merge_contextvars,
        structlog.stdlib.add_log_level,
        structlog.processors.TimeStamper(fmt="iso", utc=True, key="time"),
    ]
    if wants_json(config, stream):
        shared.append(structlog.processors.format_exc_info)
        renderer: Processor = _json_line
    else:
        renderer = structlog.dev.ConsoleRenderer(
            colors=colour, exception_formatter=structlog.dev.plain_traceback, timestamp_key="time", pad_event_to=24
        )
        shared[-1] = structlog.processors.TimeStamper(fmt="%H:%M:%S", utc=False, key="time")
    level = getattr(logging, config.level.upper())
    lines = cast("TextIO", LogStream(stream, on_lost))  # structlog and logging call write and flush alone
    structlog.configure(
        processors=[*shared, renderer],
        wrapper_class=structlog.make_filtering_bound_logger(level),
        logger_factory=structlog.WriteLoggerFactory(lines),
        cache_logger_on_first_use=False,
    )
    structlog.contextvars.clear_contextvars()
    structlog.contextvars.bind_contextvars(**bound)
    _route_libraries(shared, renderer, lines, level)
    logger: Logger = structlog.get_logger()
    _route_threads(logger)
    return logger


def _json_line(_logger: WrappedLogger, _name: str, event: EventDict) -> str:
    return msgspec.json.encode(event, enc_hook=str, order="deterministic").decode()


def _route_libraries(shared: list[Processor], renderer: Processor, stream: TextIO, level: int) -> None:
    handler = logging.StreamHandler(stream)
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=[*shared, _as_library_event],
            processors=[structlog.stdlib.ProcessorFormatter.remove_processors_meta, renderer],
        )
    )
    logging.root.handlers[:] = [handler]
    logging.root.setLevel(max(level, logging.WARNING))
    logging.captureWarnings(capture=True)


def _as_library_event(_logger: WrappedLogger, _name: str, event: EventDict) -> EventDict:
    """Keep event names a fixed set: the library's words go into a field."""
    record: logging.LogRecord = event["_record"]
    event["text"] = " ".join(str(event["event"]).split())
    event["event"] = "library_warning" if record.levelno <= logging.WARNING else "library_error"
    event["library"] = record.name
    return event


def _route_threads(logger: Logger) -> None:
    def lost(args: threading.ExceptHookArgs) -> None:
        if args.exc_value is not None:
            trace: Any = (args.exc_type, args.exc_value, args.exc_traceback)
            logger.error("thread_failed", thread=args.thread.name if args.thread else "", exc_info=trace)

    threading.excepthook = lost


def guard_stdout() -> TextIO:
    """Standard output for the log alone; whatever else writes to it goes to standard error from now on.

    Native libraries (Zenoh's Rust log, numba) print to file descriptor 1 behind Python's back.
    """
    sys.stdout.flush()
    own = os.fdopen(os.dup(sys.stdout.fileno()), "w", buffering=1, encoding="utf-8", errors="backslashreplace")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    return own
