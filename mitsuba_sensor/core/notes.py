"""Notes about a result, shown in Python, frame.json, the terminal and notebooks."""

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
    """Warns that a result is probably not the intended one, and suggests a fix.

    ::

        warnings.filterwarnings("error", category=ms.SensorWarning)
    """


class Doubt(str):
    """A note on a probably unintended result; Python raises it as a SensorWarning."""


class Caution(str):
    """A note on contributions other than the camera's: error bars, render noise, light outside the data."""


def by_weight(notes: Iterable[str]) -> list[str]:
    """Return the most important notes first: doubts, then cautions, then other notes."""
    return sorted(
        notes, key=lambda note: (not isinstance(note, Doubt), not isinstance(note, Caution))
    )


class SourceOfLight(Protocol):
    """Notes about the light that photons were collected from."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the light itself."""

    def notes_for(self, camera: Camera) -> tuple[str, ...]:
        """Return notes on this light for a camera, which may differ from the rendered camera."""

    def render_noise(
        self, frames: RawFrames
    ) -> tuple[dict[str, float | None], tuple[str, ...]]:
        """Return measures of the render noise in these frames, and notes on it."""


def warn_of(notes: Iterable[str]) -> None:
    """Issue one warning with all doubts among these notes, at the line of the user's program that called."""
    doubts = [note for note in notes if isinstance(note, Doubt)]
    if doubts:
        warnings.warn(printable(" · ".join(doubts)), SensorWarning, stacklevel=_level_of_user())


def _level_of_user() -> int:
    """Return the stack level of the first caller outside the package; :func:`warn_of` has level 1."""
    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(PACKAGE):
        level, frame = level + 1, frame.f_back
    return level
