"""When a render is good enough, and how far it is."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

from ...core import InputError
from ...core.progress import ProgressLines, automatic_progress, is_asked
from ..denoise.network import is_installed, library
from ..options import RenderOptions
from ..samples import PASSES_MIN, pass_plan, whole_grid

DEFAULT_SPP = 252  # at most, for a render that ends at the sensor's noise
DEFAULT_DENOISED_SPP = 72  # at most, if the denoiser removes the remaining noise
GROUP_SPP = 32  # at least, of each light group of such a render
PASS_SPP = 9  # samples of a pass if the noise or a time ends the render: the fewest without correlated dimensions
SURE_PASSES_MIN = (
    16  # before a noise ratio that was asked for counts as reached: 15 degrees of freedom
)
SPP_MAX = 2**16  # of a render that works towards a noise ratio, unless max_spp says otherwise

End = Literal["spp", "sensor_noise", "noise_ratio", "max_seconds", "max_spp"]


@dataclass(frozen=True)
class StopCriterion:
    """Equal passes of so many samples, at most so many of them, and what may end a render earlier.

    end : why it ends when all ``passes`` are done.
    goal, reached : noise ratio below which it ends earlier, and what that is called; None: it does not.
    percentile, sure_passes : of the lit pixels that is compared with the goal, from so many passes on.
    max_seconds : no pass begins that would end later, as far as those before tell; two are always made.
    asked : samples per pixel that were asked for, if a number was.
    grouped : whether ``samples`` are of each group of bands apart.
    """

    passes: int
    samples: int
    end: End = "spp"
    goal: float | None = None
    reached: End = "noise_ratio"
    percentile: float = 50.0
    sure_passes: int = SURE_PASSES_MIN
    max_seconds: float = math.inf
    asked: int | None = None
    grouped: bool = False
    repeatable: bool = False

    def shared(self, count: int) -> StopCriterion:
        """Return that of one of ``count`` light groups: an equal share of samples, time and variance."""
        part = replace(
            self,
            goal=None if self.goal is None else self.goal / count,
            max_seconds=self.max_seconds / count,
            asked=None,
        )
        if self.end == "max_spp":
            return replace(part, passes=max(self.passes // count, PASSES_MIN))
        least = PASSES_MIN if self.goal is None else GROUP_SPP
        spp = max(round(self.passes * self.samples / count), least)
        passes, samples = pass_plan(spp, self.repeatable)
        return replace(part, passes=passes, samples=samples)

    def finished(self, done: int, ratio: float, seconds: float) -> End | None:
        """Return why no pass follows the ``done`` ones, or None.

        ratio : the percentile of render variance over sensor variance.  seconds : so far.
        """
        if self.goal is not None and done >= self.sure_passes and ratio <= self.goal:
            return self.reached
        if done >= self.passes:
            return self.end
        if done >= 2 and seconds * (1 + 1 / done) > self.max_seconds:
            return "max_seconds"
        return None

    @property
    def most(self) -> int:
        """Passes that end the render at the latest; 0 where a noise ratio or a time ends it."""
        return 0 if self.end == "max_spp" else self.passes

    def notes(self, end: End, samples: int) -> list[str]:
        """Say why another number of samples per pixel was taken than was asked for."""
        if self.asked is None or self.asked == samples:
            return []
        why = "equal passes, each a full grid" if end == "spp" else "the time was up"
        return [f"{self.asked} samples per pixel asked for, {samples} taken: {why}"]


def stop_criterion_of(options: RenderOptions, groups: int = 1) -> StopCriterion:
    """Return when a render with these options is good enough; None is "not given". Raises InputError.

    groups : of bands, that share the samples; where there are too few for all, the bands are rendered together.
    """
    spp, max_spp = options.get("spp"), options.get("max_spp")
    ratio = options.get("noise_ratio")
    limit_s, repeatable = options.get("max_seconds"), bool(options.get("repeatable"))
    if spp is not None and ratio is not None:
        raise InputError(
            f"spp is {spp!r} and noise_ratio {ratio!r}; give one: samples, or what they reach."
        )
    if spp is not None and max_spp is not None:
        raise InputError(
            f"spp is {spp!r} and max_spp {max_spp!r}; spp is exact, max_spp goes with noise_ratio."
        )
    if repeatable and limit_s is not None:
        raise InputError(
            f"repeatable is given and max_seconds is {limit_s!r}, but time is not: take max_spp instead."
        )
    max_seconds = math.inf if limit_s is None else float(limit_s)
    unlimited = ratio is None and max_spp is None and limit_s is None
    if spp is None and unlimited and groups == 1:
        denoised = options.get("denoise") is not False and is_installed()
        most = DEFAULT_DENOISED_SPP if denoised else DEFAULT_SPP
        samples = whole_grid(PASS_SPP, repeatable)
        return StopCriterion(
            most // samples,
            samples,
            goal=1.0,
            reached="sensor_noise",
            percentile=95.0,
            sure_passes=PASSES_MIN,
            repeatable=repeatable,
        )
    if spp is not None or unlimited:  # bands in groups are for other cameras, too
        wanted = DEFAULT_SPP if spp is None else spp
        plan = pass_plan(wanted, repeatable)
        grouped = groups > 1 and math.prod(plan) >= PASSES_MIN * groups
        if grouped:
            plan = pass_plan(max(round(wanted / groups), PASSES_MIN), repeatable)
        return StopCriterion(
            *plan, max_seconds=max_seconds, asked=spp, grouped=grouped, repeatable=repeatable
        )
    most = SPP_MAX if max_spp is None else max_spp
    grouped = groups > 1 and most >= SURE_PASSES_MIN * groups
    most = most // groups if grouped else most
    samples = whole_grid(min(PASS_SPP, most / SURE_PASSES_MIN), repeatable)
    return StopCriterion(
        max(most // samples, 2),
        samples,
        end="max_spp",
        goal=ratio,
        max_seconds=max_seconds,
        grouped=grouped,
        repeatable=repeatable,
    )


def check_options(options: RenderOptions) -> None:
    """Raise InputError for options that are no use in any scene."""
    if options["denoise"]:
        library()
    if options["subframes"] is not None and options["motion"] is None:
        raise InputError(
            f"subframes is {options['subframes']!r} and nothing moves; pass a motion, or leave it out."
        )
    stop_criterion_of(options)


@dataclass(frozen=True)
class RenderProgress:
    """How far a render is: what ``progress`` is called with.

    done, most : passes, strip by strip, so far and in all; a render to the sensor's noise may end earlier, and where a
        noise ratio or a time ends it, ``most`` is 0.
    noise_ratio : render variance over sensor variance that the render works towards; NaN where it is not measured.
    seconds : so far.
    frame : number of the frame, where each frame has a render of its own.
    light_group : that is rendered now; empty where the light is rendered as a whole.
    doing : while frames are exposed to light that is there, done and most are frames.
    """

    done: int
    most: int
    noise_ratio: float = math.nan
    seconds: float = 0.0
    frame: int = 0
    light_group: str = ""
    doing: Literal["rendering", "denoising", "exposing"] = "rendering"

    @property
    def share(self) -> float:
        """Of the passes or frames that are done; NaN where their number is not known."""
        return self.done / self.most if self.most else math.nan


Progress = Callable[[RenderProgress], None]


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
