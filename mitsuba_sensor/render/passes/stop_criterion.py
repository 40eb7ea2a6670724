"""Stop criterion of a render, and its progress."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Literal

from ...core import InputError
from ...core.progress import automatic_progress, is_asked
from ..denoise.network import is_installed, library
from ..options import RenderOptions
from ..samples import PASSES_MIN, pass_plan, whole_grid

DEFAULT_SPP = 252  # at most, for a render that ends at the sensor's noise
DEFAULT_DENOISED_SPP = 72  # at most, if the denoiser removes the remaining noise
GROUP_SPP = 32  # at least, of each light group of such a render
PASS_SPP = 9  # samples of a pass if the noise or a time ends the render: the fewest without correlated dimensions
SURE_PASSES_MIN = 16  # before a requested noise ratio is compared: 15 degrees of freedom
SPP_MAX = 2**16  # of a render with a noise ratio or a time, unless max_spp is given

End = Literal["spp", "sensor_noise", "noise_ratio", "max_seconds", "max_spp"]


@dataclass(frozen=True)
class StopCriterion:
    """Number and size of the equal passes of a render, and what ends it earlier.

    passes, samples : largest number of passes, and samples per pixel of each.
    end : reason to stop after all ``passes``.
    goal, reached : noise ratio that ends the render earlier (None: none does), and the reason that it is reported as.
    percentile, sure_passes : of the lit pixels, compared with the goal; the fewest passes before it is compared.
    max_seconds : time limit. No pass starts that would probably end later, but two passes are always made.
    asked : requested samples per pixel, if any.
    grouped : True if each group of bands takes ``samples`` samples.
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
        """Return the criterion for one of ``count`` light groups: equal fractions of samples, time and variance."""
        part = replace(
            self,
            goal=None if self.goal is None else self.goal / count,
            max_seconds=self.max_seconds / count,
            asked=None,
        )
        passes = self.passes // count
        if self.end == "max_spp" or (self.goal is not None and passes >= PASSES_MIN):
            return replace(part, passes=max(passes, PASSES_MIN))
        least = PASSES_MIN if self.goal is None else GROUP_SPP
        spp = max(round(self.passes * self.samples / count), least)
        passes, samples = pass_plan(spp, self.repeatable)
        return replace(part, passes=passes, samples=samples)

    def finished(self, done: int, ratio: float, seconds: float) -> End | None:
        """Return the reason to stop after ``done`` passes and ``seconds``, or None.

        ratio : percentile of the render variance over the sensor variance.
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
        """Number of passes if nothing ends the render earlier; 0 if a noise ratio or a time ends it."""
        return 0 if self.end == "max_spp" else self.passes

    def notes(self, end: End, samples: int) -> list[str]:
        """Return a note if a time limit ended the render before the requested samples per pixel."""
        if self.asked is None or end == "spp":
            return []
        return [
            f"took {samples} samples per pixel instead of {self.asked}, because max_seconds was reached"
        ]


def stop_criterion_of(options: RenderOptions, groups: int = 1) -> StopCriterion:
    """Return the stop criterion for render options; None means "not given". Raises InputError.

    groups : number of groups of bands, which share the samples. If there are too few samples for all groups, all bands
        are rendered together.
    """
    spp, max_spp = options.get("spp"), options.get("max_spp")
    ratio = options.get("noise_ratio")
    limit_s, repeatable = options.get("max_seconds"), bool(options.get("repeatable"))
    if spp is not None and ratio is not None:
        raise InputError(f"spp is {spp!r} and noise_ratio is {ratio!r}; omit one of them.")
    if spp is not None and max_spp is not None:
        raise InputError(
            f"spp is {spp!r} and max_spp is {max_spp!r}; omit max_spp, which limits a render with noise_ratio."
        )
    if repeatable and limit_s is not None:
        raise InputError(
            f"repeatable excludes max_seconds={limit_s!r}, because times are not repeatable; use max_spp instead."
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
    if spp is not None or unlimited:  # groups of bands are also for other cameras
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
    """Raise InputError for options that exclude each other in every scene."""
    if options["denoise"]:
        library()
    if options["subframes"] is not None and options["motion"] is None:
        raise InputError(
            f"subframes is {options['subframes']!r} and nothing moves; pass motion=, or omit subframes."
        )
    stop_criterion_of(options)


@dataclass(frozen=True)
class RenderProgress:
    """State of a render, the argument of ``progress``.

    done, most : finished and planned passes, counted for each strip of rows; frames while ``doing`` is "exposing". A
        render may end earlier at the sensor's noise. If a noise ratio or a time ends it, ``most`` is 0.
    noise_ratio : render variance over sensor variance that the render works towards; NaN before it is measured.
    seconds : run time.
    frame : number of the frame, if each frame has its own render.
    light_group : name of the light group being rendered; empty if the light is rendered as a whole.
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
        """Fraction of the passes or frames that is done; NaN if their number is unknown."""
        return self.done / self.most if self.most else math.nan


Progress = Callable[[RenderProgress], None]


def standing(step: RenderProgress, options: Mapping[str, Any]) -> tuple[str, float]:
    """Return the current activity of a capture with these options, and the fraction of its renders that is done (NaN if
    unknown)."""
    if step.doing == "exposing":
        if step.done == step.most:
            return "report and files", math.nan
        return f"exposing frame {step.done + 1} of {step.most}", step.share
    frames = options.get("frames", 1)
    if options.get("render_noise", "shared") == "shared" or frames == 1:
        return f"{step.doing} {step.light_group}".rstrip(), step.share
    number = step.frame - options.get("first_frame", 0)
    finished = 0.0 if math.isnan(step.share) else step.share
    return f"{step.doing} frame {number + 1} of {frames}", (number + finished) / frames


@contextmanager
def told_progress(
    progress: Progress | bool | None,
    name: str,
    options: Mapping[str, Any],
    thread: bool = True,
) -> Iterator[Progress | None]:
    """Yield the function that a render reports to: ``progress`` itself, None for False, or for None a function that
    writes a line every ten seconds.

    name : function that the user called.  options : its options.  Raises InputError.
    """
    if callable(progress):
        yield progress
    elif not is_asked(progress):
        yield None
    else:
        with automatic_progress(name, "loading the scene", thread) as lines:

            def tell(step: RenderProgress) -> None:
                assert lines is not None
                lines.tell(*standing(step, options))
                lines.tick()

            yield None if lines is None else tell
