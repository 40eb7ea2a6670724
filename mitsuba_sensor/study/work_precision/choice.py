"""Which options of the command line reach an error in the least time, as the fits tell, and a render that checks it."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...render.passes import FEWEST, MOST_IN_ALL, SAMPLER
from ...render.photons import collect
from ...render.stop_criterion import stop_criterion_of
from ..subject import Subject
from .reference import Target, electrons_of
from .render_results import Result

FEWEST_SPP = 16
CHECK_SEEDS = (1001, 1002)  # no run and no reference has them. The first compiles, the second is timed
MARGIN = 1.1  # on the samples that a check asks for: its error is known to some percent


@dataclass(frozen=True)
class Choice:
    """Options of ``mitsuba-sensor render``, and what they are expected to give.

    usual : whether the variant is the one that is taken by itself, and need not be named.
    seconds, error : predicted; relative rms error of the electrons.
    """

    spectral: str
    spp: int
    denoise: bool
    variant: str
    usual: bool
    seconds: float
    error: float

    @property
    def options(self) -> str:
        """As they are typed."""
        variant = "" if self.usual else f" --variant {self.variant}"
        return f"--spp {self.spp} --spectral {self.spectral}{' --denoise' if self.denoise else ''}{variant}"


class Law:
    """Error and time of a setting for any number of samples.

    What passes of other sizes gain and cost is known of the base setting, and taken to be the same here.
    result : of the setting.  sizes : results of the base setting, for each size of pass.
    """

    def __init__(self, result: Result, sizes: Sequence[Result]) -> None:
        ordered = sorted(sizes, key=lambda one: one.ladder.samples)
        here = next(one for one in ordered if one.ladder.samples == result.ladder.samples)
        self._groups, self._result = result.ladder.groups, result
        self._size = np.log([one.ladder.samples for one in ordered])
        self._square = np.log([one.square_of_one_pass / here.square_of_one_pass for one in ordered])
        self._second = np.log([one.pass_s / here.pass_s for one in ordered])

    def predict(self, spp: int) -> tuple[float, float] | None:
        """Seconds and error of --spp; None where the bands would not be rendered apart."""
        criterion = stop_criterion_of({"spp": spp}, self._groups)
        if criterion.grouped != (self._groups > 1):
            return None
        size = math.log(criterion.samples)
        known = min(size, self._size[-1])  # beyond, a pass takes as much longer as it has more samples
        seconds = self._result.pass_s * math.exp(_line(known, self._size, self._second) + size - known)
        square = self._result.square_of_one_pass * math.exp(_line(size, self._size, self._square))
        return criterion.passes * seconds, math.sqrt(square / criterion.passes)


def _line(x: float, known: Any, values: Any) -> float:
    """Linear between the points; beyond them as between the last two."""
    if len(known) < 2:
        return float(values[0])
    k = int(np.clip(np.searchsorted(known, x), 1, len(known) - 1))
    slope = (values[k] - values[k - 1]) / (known[k] - known[k - 1])
    return float(values[k] + slope * (x - known[k]))


def sample_counts() -> Iterator[int]:
    """Numbers of samples that are tried: 16, 24, 32, 48, 64, …"""
    count = FEWEST_SPP
    while count <= MOST_IN_ALL:
        yield count
        yield count * 3 // 2
        count *= 2


def choices(results: Sequence[Result], tolerance: float, usual: str) -> list[Choice]:
    """The cheapest options of every kind that reach the tolerance, the quickest first.

    results : the base setting first.  usual : the variant that is taken by itself.
    """
    base, found = results[0], []
    known = [one for one in results if one.points("electrons")]
    sizes = [one for one in known if replace(one.setting, samples=base.setting.samples) == base.setting]
    for result in known if base in known else []:
        setting = result.setting
        choosable = setting.sampler == SAMPLER and setting.banding != "loop"
        if choosable and setting.samples == base.setting.samples:
            tried = ((spp, told) for spp in sample_counts() if (told := Law(result, sizes).predict(spp)))
            reached = next(((spp, told) for spp, told in tried if told[1] <= tolerance), None)
            if reached is not None:
                spp, told = reached
                found.append(Choice(setting.banding, spp, False, setting.variant, setting.variant == usual, *told))
    for point in base.points("electrons", "denoised"):  # it has a bias, and no law: what was measured of it
        if point.passes >= FEWEST and point.error <= tolerance:
            spp, variant = point.passes * base.ladder.samples * base.ladder.groups, base.setting.variant
            found.append(Choice("auto", spp, True, variant, variant == usual, point.seconds, point.error))
            break
    return sorted(found, key=lambda choice: choice.seconds)


def corrected(choice: Choice, error: float, tolerance: float) -> Choice:
    """The same with as many more samples as an error that was found says."""
    more = MARGIN * (error / tolerance) ** 2
    spp = next(count for count in sample_counts() if count >= min(choice.spp * more, MOST_IN_ALL))
    return replace(choice, spp=spp, seconds=choice.seconds * spp / choice.spp, error=tolerance / math.sqrt(MARGIN))


def checked(subject: Subject, choice: Choice, target: Target) -> dict[str, float]:
    """Render with these very options and compare with the reference: seconds and relative error of electrons."""
    squares, seconds = [], math.nan
    asked = {"spp": choice.spp, "spectral": choice.spectral, "denoise": choice.denoise, "variant": choice.variant}
    for seed in CHECK_SEEDS:
        light = subject.render(seed, **asked)
        off = electrons_of(collect(light, subject.camera, subject.exposure), subject) - target.electrons
        squares.append(target.scale.mean_square("electrons", off) - target.squares["electrons"])
        seconds = light.statistics.seconds
    return {"seconds": seconds, "error": math.sqrt(max(statistics.fmean(squares), 0.0))}
