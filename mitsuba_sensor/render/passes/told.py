"""What a render tells of how far it is, in one sentence, whoever shows it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import NamedTuple

from ...core.progress import ProgressLines, automatic_progress, is_asked
from .stop_criterion import Progress, RenderProgress

FILES = "report and files"
"""The last step of a capture."""


class Standing(NamedTuple):
    """What is done now, and the share of all renders that is done; NaN where it is not known."""

    doing: str
    share: float


class Series:
    """How many renders there are, and the number of the first frame.  options : of a capture."""

    def __init__(self, options: Mapping[str, object]) -> None:
        frames, first = options.get("frames", 1), options.get("first_frame", 0)
        if not isinstance(frames, int) or not isinstance(first, int):
            frames, first = 1, 0  # what is no number is refused when it is used
        self.first = first
        self.renders = 1 if options.get("render_noise", "shared") == "shared" else frames

    def standing(self, step: RenderProgress) -> Standing:
        """Of all renders."""
        doing = self._doing(step)
        if doing == FILES or self.renders == 1 or step.doing == "exposing":
            return Standing(doing, math.nan if doing == FILES else step.share)
        own = 0.0 if math.isnan(step.share) else step.share
        return Standing(doing, (step.frame - self.first + own) / self.renders)

    def _doing(self, step: RenderProgress) -> str:
        if step.doing == "exposing":
            last = step.done == step.most
            return FILES if last else f"exposing frame {step.done + 1} of {step.most}"
        if self.renders == 1:
            return f"{step.doing} {step.light_group}".rstrip()
        return f"{step.doing} frame {step.frame - self.first + 1} of {self.renders}"


@contextmanager
def told_progress(
    progress: Progress | bool | None,
    name: str,
    options: Mapping[str, object],
    thread: bool = True,
) -> Iterator[Progress | None]:
    """What a render reports to: the given function, nothing for False, and for None a line every ten seconds.

    name : of the function that the user called.  options : its options.  Raises InputError.
    """
    if callable(progress):
        yield progress
        return
    if not is_asked(progress):
        yield None
        return
    with automatic_progress(name, "loading the scene", thread) as teller:
        yield None if teller is None else _teller_of(teller, Series(options))


def _teller_of(teller: ProgressLines, series: Series) -> Callable[[RenderProgress], None]:
    def tell(step: RenderProgress) -> None:
        teller.tell(*series.standing(step))
        teller.tick()

    return tell
