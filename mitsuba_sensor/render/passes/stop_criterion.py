"""When a render is good enough, and how far it is."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Literal

from ...core import InputError
from ..denoise.network import library
from ..options import RenderOptions
from .passes import FEWEST, pass_plan, whole_grid

DEFAULT_SPP = 256  # at most: 32 passes of 8
DEFAULT_PASS_SPP = 8
FIRST_LOOK = 8  # passes of the default render, before it is compared with the sensor's noise
# Render variance over sensor variance falls as samples^-0.75 where it is denoised: its gain falls, too.
RATIO_EXPONENT = 0.75
GROUP_LAUNCH = 4  # passes of a light group that are made at once: of all groups, because it is part of a kernel
FEWEST_TO_STOP = 16  # passes before a goal counts as reached: 15 degrees of freedom
SIZED = 32  # passes that a render towards a goal is sized for
PASS_SPP = 16  # of the first pass of a render without a fixed number; it tells how large the others are
MOST_SPP_ASKED = (
    2**16
)  # of a render that works towards a noise ratio, unless max_spp says otherwise

End = Literal["spp", "sensor_noise", "noise_ratio", "compensable", "max_seconds", "max_spp"]


@dataclass(frozen=True)
class StopCriterion:
    """How many passes of how many samples; fixed, or until one of the limits is met.

    to_sensor_noise : whether the render ends earlier, where 95 % of the lit pixels have less render noise than sensor
        noise.
    passes : the most there may be.  samples : per pixel and pass; of the first pass where the rest is not ``sized``.
    goal, reached : value of the renderer's criterion at which to stop, or None, and what that is called.
    max_seconds : no pass is begun that would end later, as far as those before tell; two are always made.
    launch : passes that are made at once where so many fit on a film; None: as many as is best.
    grouped : whether ``samples`` are of each group of bands apart.
    repeatable : see :func:`passes.pass_plan`.
    sensor_noise_share : of the sensor's noise that the render's may have; less than 1 of a light group.
    end : why it ends when ``passes`` are done.  asked : samples per pixel that were asked for, if a number was.
    """

    passes: int
    samples: int
    goal: float | None = None
    reached: End = "noise_ratio"
    max_seconds: float = math.inf
    end: End = "spp"
    asked: int | None = None
    sized: bool = True
    launch: int | None = None
    grouped: bool = False
    repeatable: bool = False
    to_sensor_noise: bool = False
    sensor_noise_share: float = 1.0

    def for_share(self, share: float) -> StopCriterion:
        """That of a light group with this share of the samples, and of the variance that the render may have.

        A kernel has in it how many samples a pass has, and how many passes are made at once. So groups have passes of
        a few sizes, each twice as large as the one before, in multiples of what is made at once.
        """
        within = replace(
            self,
            goal=None if self.goal is None else self.goal * share,
            max_seconds=self.max_seconds * share,
            sensor_noise_share=self.sensor_noise_share * share,
            asked=None,
        )
        if self.to_sensor_noise or not self.sized:
            return replace(within, passes=max(round(self.passes * share), FIRST_LOOK))
        wanted = max(self.passes * self.samples * share, FEWEST)
        samples = whole_grid(2 ** int(math.log2(wanted / FEWEST)), self.repeatable)
        launches = max(round(wanted / samples / GROUP_LAUNCH), FEWEST // GROUP_LAUNCH)
        passes = launches * GROUP_LAUNCH
        return replace(within, passes=passes, samples=samples, launch=GROUP_LAUNCH)

    def together(self, most: int) -> int:
        """How many passes are made at once, at most ``most``; one where anything but their number can end the render.

        It divides their number, so that all launches share a kernel, and is not all of them if two halves will do: the
        first one compiles, the second tells how long a pass takes. Of a render to the sensor's noise the passes before
        the first look count.
        """
        if not self.sized or self.goal is not None or math.isfinite(self.max_seconds):
            return 1
        if self.launch is not None:
            return self.launch if self.launch <= most else 1
        passes = min(self.passes, FIRST_LOOK) if self.to_sensor_noise else self.passes
        divisors = [n for n in range(1, min(most, passes) + 1) if passes % n == 0]
        return max([n for n in divisors if 1 < n <= passes // 2] or divisors)

    def first_look(self) -> int | None:
        """Passes after which the render is first compared with the sensor's noise; None where it never is."""
        return FIRST_LOOK if self.to_sensor_noise else None

    def next_look(self, done: int, ratio: float) -> int | None:
        """Passes after which to compare again; None where nothing is left to save.

        done, ratio : passes so far, and render variance over sensor variance that is more than it should be.
        """
        needed: float = done * (ratio / self.sensor_noise_share) ** (1 / RATIO_EXPONENT)
        if needed > self.passes - FIRST_LOOK:
            return None
        return math.ceil(needed / FIRST_LOOK) * FIRST_LOOK

    def finished(self, done: int, value: float, seconds: float, per_pass: float) -> End | None:
        """Why there is no further pass after ``done``, or None."""
        if done >= self.passes:
            return self.end
        if self.goal is not None and done >= FEWEST_TO_STOP and value <= self.goal:
            return self.reached
        if done >= 2 and seconds + per_pass > self.max_seconds:
            return "max_seconds"
        return None

    @property
    def most(self) -> int:
        """How many passes end the render at the latest; 0 where a noise ratio or a time ends it."""
        return 0 if self.end == "max_spp" else self.passes

    def notes(self, end: End, samples: int) -> list[str]:
        """Where another number of samples per pixel was taken than was asked for: why."""
        if self.asked is None or self.asked == samples:
            return []
        why = "equal passes, each a full grid" if end == "spp" else "the time was up"
        return [f"{self.asked} samples per pixel asked for, {samples} taken: {why}"]

    def sized_by(self, value: float, seconds: float) -> StopCriterion:
        """The same with the size of the passes, from what one pass of ``samples`` showed: about 32 of them."""
        needed = float(self.passes * self.samples)
        if self.goal is not None and math.isfinite(value):
            needed = min(needed, self.samples * value / self.goal)
        if math.isfinite(self.max_seconds) and seconds > 0:
            needed = min(needed, self.samples * max(self.max_seconds / seconds - 1, 1))
        samples = max(whole_grid(needed / SIZED), self.samples)
        return replace(
            self,
            samples=samples,
            passes=max(self.passes * self.samples // samples, 2),
            sized=True,
        )


@dataclass(frozen=True)
class RenderProgress:
    """How far a render is: what ``progress`` is called with.

    done, most : passes, strip by strip, so far and in all; a render to the sensor's noise may end earlier, and where a
        noise ratio or a time ends it, ``most`` is 0.
    noise_ratio : median of render variance over sensor variance so far; NaN before the first pass ends.
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


class ProgressMeter:
    """Times a render of some strips of rows, and reports to ``progress``."""

    def __init__(self, progress: Progress) -> None:
        self._progress, self._started = progress, time.monotonic()
        self._value, self._most = math.nan, 0
        self.later_pass_s = 0.0  # of one after those that compile

    def begin(self, strips: int) -> None:
        """Passes of so many strips start now."""
        self._strips, self._began = strips, time.monotonic()
        self._first = self._began, 0  # when the first passes ended, and how many they were

    def times(self, passes: int) -> tuple[float, float]:
        """Seconds since the render started, and per pass since :meth:`begin`."""
        now = time.monotonic()
        return now - self._started, (now - self._began) / max(passes, 1)

    def passed(self, most: int, passes: int, value: float) -> None:
        """So many passes of at most ``most`` are done, and the criterion has this value."""
        seconds, per_pass = self.times(passes)
        now = self._started + seconds
        if not self._first[1]:
            self._first = now, passes
        ended, first = self._first
        self.later_pass_s = (now - ended) / (passes - first) if passes > first else per_pass
        self._most, self._value = most, value
        self.report(passes * self._strips)

    @contextmanager
    def not_counted(self) -> Iterator[None]:
        """What happens within is not a pass, and its time is not counted as one's."""
        started = time.monotonic()
        yield
        seconds = time.monotonic() - started
        self._began += seconds
        self._first = self._first[0] + seconds, self._first[1]

    def report_denoising(self) -> None:
        """The passes so far are denoised, to see whether they suffice; what follows is not known."""
        self._progress(RenderProgress(0, 0, self._value, self.times(1)[0], doing="denoising"))

    def report(self, strips: int) -> None:
        """So many strips of all passes are done."""
        seconds, most = self.times(1)[0], self._most * self._strips
        self._progress(RenderProgress(strips, most, self._value, seconds))


def stop_criterion_of(options: RenderOptions, groups: int = 1) -> StopCriterion:
    """When a render with these options is good enough; None is "not given". Raises InputError. groups : of bands, that
    share the samples; where there are too few for all, the bands are rendered together."""
    spp, noise_ratio, max_spp = (
        options.get("spp"),
        options.get("noise_ratio"),
        options.get("max_spp"),
    )
    if spp is not None and noise_ratio is not None:
        raise InputError(
            f"spp is {spp!r} and noise_ratio {noise_ratio!r}; give one: samples, or what they reach."
        )
    if spp is not None and max_spp is not None:
        raise InputError(
            f"spp is {spp!r} and max_spp {max_spp!r}; spp is exact, max_spp goes with noise_ratio."
        )
    limit_s = options.get("max_seconds")
    max_seconds, repeatable = (
        math.inf if limit_s is None else limit_s,
        bool(options.get("repeatable")),
    )
    if repeatable and limit_s is not None:
        raise InputError(
            f"repeatable is given and max_seconds is {limit_s!r}, but time is not: take max_spp instead."
        )
    unlimited = noise_ratio is None and max_spp is None and limit_s is None
    if spp is None and unlimited and groups == 1:
        passes = DEFAULT_SPP // DEFAULT_PASS_SPP
        return StopCriterion(
            passes, DEFAULT_PASS_SPP, repeatable=repeatable, to_sensor_noise=True
        )
    if spp is not None or unlimited:  # bands in groups are for other cameras, too
        wanted = DEFAULT_SPP if spp is None else spp
        plan = pass_plan(wanted, repeatable)
        grouped = groups > 1 and math.prod(plan) >= FEWEST * groups
        plan = pass_plan(max(round(wanted / groups), FEWEST), repeatable) if grouped else plan
        return StopCriterion(
            *plan, max_seconds=max_seconds, asked=spp, grouped=grouped, repeatable=repeatable
        )
    most = MOST_SPP_ASKED if max_spp is None else max_spp
    grouped = groups > 1 and most >= FEWEST_TO_STOP * groups
    most = most // groups if grouped else most
    samples = (
        PASS_SPP
        if most >= FEWEST_TO_STOP * PASS_SPP and not repeatable
        else pass_plan(most, repeatable)[1]
    )
    return StopCriterion(
        max(most // samples, 2),
        samples,
        noise_ratio,
        max_seconds=max_seconds,
        end="max_spp",
        sized=repeatable,
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
