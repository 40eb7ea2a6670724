"""Which words of the command line reach an error in the least time, as the fits tell, and a render that checks it."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...render.irradiance import render
from ...render.lint import SAMPLER
from ...render.passes import FEWEST, MOST_IN_ALL
from ...render.photons import collect
from ...render.stop_criterion import stop_criterion_of
from .reference import Truth, electrons_of
from .results import Result
from .series import Subject

FEWEST_SPP = 16
CHECK_S = 15.0
"""A recommendation that takes longer is not checked."""
CHECK_SEEDS = (1001, 1002)
"""No run and no reference has them. The first compiles, the second is timed."""
MARGIN = 1.1
"""On the samples that a check asks for: its error is known to some percent."""


@dataclass(frozen=True)
class Choice:
    """Words of ``mitsuba-sensor render``, and what they are expected to give.

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
    def words(self) -> str:
        """As they are typed."""
        variant = "" if self.usual else f" --variant {self.variant}"
        return f"--spp {self.spp} --spectral {self.spectral}{' --denoise' if self.denoise else ''}{variant}"


class Law:
    """Error and time of a setting for any number of samples.

    What passes of other sizes gain and cost is known of the setting in the middle, and taken to be the same here.
    result : of the setting.  sizes : results of the one in the middle, for each size of pass.  groups : of its bands.
    """

    def __init__(self, result: Result, sizes: Sequence[Result], groups: int) -> None:
        ordered = sorted(sizes, key=lambda one: one.ladder["samples"])
        here = next(one for one in ordered if one.ladder["samples"] == result.ladder["samples"])
        self._groups, self._result = groups, result
        self._size = np.log([one.ladder["samples"] for one in ordered])
        self._square = np.log([one.square_of_one_pass / here.square_of_one_pass for one in ordered])
        self._second = np.log([one.pass_s / here.pass_s for one in ordered])

    def predict(self, spp: int) -> tuple[float, float] | None:
        """Seconds and error of --spp; None where the bands would not be rendered apart."""
        budget = stop_criterion_of(spp, None, None, None, self._groups)
        if budget.grouped != (self._groups > 1):
            return None
        size = math.log(budget.samples)
        known = min(size, self._size[-1])  # beyond, a pass takes as much longer as it has more samples
        seconds = self._result.pass_s * math.exp(_line(known, self._size, self._second) + size - known)
        square = self._result.square_of_one_pass * math.exp(_line(size, self._size, self._square))
        return budget.passes * seconds, math.sqrt(square / budget.passes)


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
    """The cheapest words of every kind that reach the tolerance, the quickest first.

    results : the setting in the middle first.  usual : the variant that is taken by itself.
    """
    base = results[0]
    sizes = [one for one in results if replace(one.setting, samples=base.setting.samples) == base.setting]
    sizes = [one for one in sizes if one.points("electrons")]
    found = []
    for result in results:
        setting = result.setting
        choosable = setting.sampler == SAMPLER and setting.banding != "loop" and result.points("electrons")
        if not choosable or setting.samples != base.setting.samples or base not in sizes:
            continue
        law = Law(result, sizes, result.ladder["groups"])
        for spp in sample_counts():
            if (told := law.predict(spp)) and told[1] <= tolerance:
                found.append(Choice(setting.banding, spp, False, setting.variant, setting.variant == usual, *told))
                break
    found += [choice for choice in _denoised(base, usual) if choice.error <= tolerance][:1]
    return sorted(found, key=lambda choice: choice.seconds)


def _denoised(base: Result, usual: str) -> Iterator[Choice]:
    """What was measured of the denoiser, with as many passes as a render has at least; it has a bias, and no law."""
    for point in base.points("electrons", "denoised"):
        if point.passes >= FEWEST:
            spp = point.passes * base.ladder["samples_per_pass"]
            variant = base.setting.variant
            yield Choice("auto", spp, True, variant, variant == usual, point.seconds, point.error)


def corrected(choice: Choice, error: float, tolerance: float) -> Choice:
    """The same with as many more samples as an error that was found says."""
    more = MARGIN * (error / tolerance) ** 2
    spp = next(count for count in sample_counts() if count >= min(choice.spp * more, MOST_IN_ALL))
    return replace(choice, spp=spp, seconds=choice.seconds * spp / choice.spp, error=tolerance / math.sqrt(MARGIN))


def checked(subject: Subject, choice: Choice, truth: Truth, own_square: float) -> dict[str, float]:
    """Render with these very words and hold the light against the reference: seconds and relative error of electrons.

    own_square : squared relative error of the reference.
    """
    squares, seconds = [], math.nan
    for seed in CHECK_SEEDS:
        light = render(
            subject.scene, subject.camera, subject.exposure, seed=seed, spp=choice.spp, spectral=choice.spectral,
            denoise=choice.denoise, variant=choice.variant, parameters=subject.parameters,
            scene_unit=subject.scene_unit, columns=subject.columns,
        )  # fmt: skip
        photons = collect(light, subject.camera, subject.exposure)
        squares.append(truth.scale.of_electrons((electrons_of(photons, subject) - truth.electrons) ** 2) - own_square)
        seconds = light.statistics.seconds
    return {"seconds": seconds, "error": math.sqrt(max(statistics.fmean(squares), 0.0))}
