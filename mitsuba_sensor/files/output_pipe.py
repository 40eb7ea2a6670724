"""The standard output where it is a pipe that nobody reads any more, as that of ``| head -1``."""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress

BROKEN_PIPE = 128 + getattr(
    signal, "SIGPIPE", 13
)  # exit code that a shell reports of a program that ends so


def silence_output() -> None:
    """Let nothing more be written there, not even when the program ends."""
    with suppress(OSError, ValueError, AttributeError):  # there is no file behind it
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, sys.stdout.fileno())
        os.close(null)


def flush_output() -> None:
    """Write what is left. Ends the program if nobody reads it."""
    try:
        if sys.stdout is not None:  # the caller may have closed it
            sys.stdout.flush()
    except BrokenPipeError:
        silence_output()
        raise SystemExit(BROKEN_PIPE) from None
