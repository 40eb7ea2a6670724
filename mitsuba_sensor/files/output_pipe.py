"""Standard output and standard error that are pipes without a reader, e.g. after ``| head -1``."""

from __future__ import annotations

import io
import os
import sys
from contextlib import suppress


class LastingOutput(io.TextIOWrapper):
    """Text output that discards text after its reader has ended, so the program continues to its usual exit code."""

    def write(self, text: str, /) -> int:
        """Return the number of characters, written or discarded."""
        try:
            return super().write(text)
        except BrokenPipeError:
            self._lose_the_rest()
            return len(text)

    def flush(self) -> None:
        """Write buffered text, if there is a reader."""
        try:
            super().flush()
        except BrokenPipeError:
            self._lose_the_rest()

    def _lose_the_rest(self) -> None:
        """Redirect all further output, also at exit, to the null device."""
        with suppress(OSError, ValueError):  # not a file
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, self.fileno())
            os.close(null)


def outlast_readers() -> None:
    """Let the program continue when the reader of its output ends; show ? for characters that the terminal lacks."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if isinstance(stream, io.TextIOWrapper):
            encoding, line_buffering = stream.encoding, stream.line_buffering
            lasting = LastingOutput(
                stream.detach(),
                encoding,
                "replace" if name == "stdout" else "backslashreplace",
                line_buffering=line_buffering,
            )
            setattr(sys, name, lasting)
