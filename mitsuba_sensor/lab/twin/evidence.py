"""A fitted figure with the frames that it came from, and how frames are named."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass

from ..frames.stack import Stack
from ..quantity import Quantity


@dataclass(frozen=True)
class Fitted:
    """A figure and its frames.

    assumed : what the number is where frames do not show it, or nothing.
    """

    quantity: Quantity
    frames: str

    @property
    def known(self) -> bool:
        """Whether the frames show it."""
        return math.isfinite(self.quantity.value)

    @property
    def source(self) -> str:
        """``fit: 2.31 (2.29 to 2.33) e-, 64 frames dark_10ms/…``."""
        q = self.quantity
        figure = f"{q.value:.4g} ({q.low:.4g} to {q.high:.4g}) {q.unit}".rstrip()
        text = f"fit: {figure}, {self.frames}"
        if q.note:
            text += f"; {q.note}"
        return text

    def known_as(self, quantity: Quantity) -> Fitted:
        """Another figure of the same frames."""
        return Fitted(quantity, self.frames)


def frames_of(*stacks: Stack) -> str:
    """How many frames of which files: ``64 frames dark_10ms/a.tiff … b.tiff``."""
    count = sum(len(stack) for stack in stacks)
    sources = list(dict.fromkeys(short(stack.source) for stack in stacks))
    shown = ", ".join(sources[:2])
    if len(sources) > 2:
        shown += f" and {len(sources) - 2} more stacks"
    return f"{count} frame{'s' * (count != 1)} {shown}"


def short(source: str) -> str:
    """The last two parts of the path of the first file."""
    first, dots, _ = source.partition(" … ")
    parts = first.replace(os.sep, "/").split("/")
    if not dots:
        return "/".join(parts[-2:])
    if len(parts) > 1:
        return f"{parts[-2]}/…"
    return f"{first} …"
