"""What one side of a study hands to the whole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .page import Part, Progress


@dataclass(frozen=True)
class Side:
    """Render side or sensor side of the work-precision diagrams; fields as in :class:`page.Study`."""

    findings: tuple[str, ...]
    passed: bool
    parts: tuple[Part, ...]
    data: dict[str, Any]


def later(progress: Progress, before_s: float, after_s: float) -> Progress:
    """``progress`` for a part of the work: so many seconds were spent before it, so many are expected after it."""
    return lambda done_s, expected_s, words: progress(before_s + done_s, before_s + expected_s + after_s, words)
