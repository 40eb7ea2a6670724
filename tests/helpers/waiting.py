"""Waits for what another process does."""

import time
from collections.abc import Callable

WAIT_S = 300
"""Long enough for a machine whose processors are all taken by other programs."""


def wait_until(condition: Callable[[], bool]) -> None:
    """Wait for at most ``WAIT_S``, and fail then."""
    deadline = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < deadline, f"this has not happened in {WAIT_S} s"
        time.sleep(0.02)
