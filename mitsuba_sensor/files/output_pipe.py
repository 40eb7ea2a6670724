"""Standard output and standard error where they are pipes that nobody reads any more, as those of ``| head -1``."""

from __future__ import annotations

import io
import os
import sys
from contextlib import suppress


class LastingOutput(io.TextIOWrapper):
    """Text output that goes on when its reader has gone: the rest is lost, and nobody misses it.

    The program ends as it would otherwise, with the same exit code.
    """

    def write(self, text: str, /) -> int:
        """Number of characters, written or lost."""
        try:
            return super().write(text)
        except BrokenPipeError:
            self._lose_the_rest()
            return len(text)

    def flush(self) -> None:
        """Write what is left, if somebody reads it."""
        try:
            super().flush()
        except BrokenPipeError:
            self._lose_the_rest()

    def _lose_the_rest(self) -> None:
        """Let nothing more be written there, not even when the program ends."""
        with suppress(OSError, ValueError):  # there is no file behind it
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, self.fileno())
            os.close(null)


def outlast_readers() -> None:
    """From now on the program goes on where nobody reads its output.

    A terminal without × and µ shows ? in their place.
    """
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
