"""Notes: sentences about a result, the same in Python, in frame.json, on the terminal and in a notebook."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from .printable import printable

if TYPE_CHECKING:
    from ..camera.camera import Camera
    from ..sensor.frames import RawFrames

PACKAGE = f"{Path(__file__).parent.parent}{os.sep}"


class SensorWarning(UserWarning):
    """A result that is probably not the one that was wanted; the text says why, and the way out.

    ::

        warnings.filterwarnings("error", category=ms.SensorWarning)
    """


class Doubt(str):
    """A note on a result that is probably not the one that was wanted: Python warns of it."""


class Caution(str):
    """A note on how much of a result is not the camera's: error bars, render noise, light beyond the data."""


def by_weight(notes: Iterable[str]) -> list[str]:
    """The notes that change most first: doubts on the result, then cautions, then the others."""
    return sorted(
        notes, key=lambda note: (not isinstance(note, Doubt), not isinstance(note, Caution))
    )


class SourceOfLight(Protocol):
    """What is known of the light that photons were collected from."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the light itself."""

    def notes_for(self, camera: Camera) -> tuple[str, ...]:
        """Notes on this light before a camera, which may be another one than it was rendered for."""

    def render_noise(
        self, frames: RawFrames
    ) -> tuple[dict[str, float | None], tuple[str, ...]]:
        """What the render's noise means in these frames, and the notes on it."""


def warn_of(notes: Iterable[str]) -> None:
    """Warn once of all doubts among these notes, at the line of the user's program that called this package."""
    doubts = [note for note in notes if isinstance(note, Doubt)]
    if doubts:
        warnings.warn(printable(" · ".join(doubts)), SensorWarning, stacklevel=_level_of_user())


def _level_of_user() -> int:
    """Which caller of :func:`warn_of` is the first one outside the package; warn_of itself is number 1."""
    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(PACKAGE):
        level, frame = level + 1, frame.f_back
    return level
