"""What a render got wrong: of irradiance, of electrons, of the mean and the temporal σ of the digital numbers.

A run of passes is cut into all its blocks of 1, 2, 4, … of them. Each block is a render of its own, and all of one size
are averaged, so that a rare bright path counts alike in blocks of every size; what is left to chance in a slope is only
how the errors of different passes happen to line up. Seconds are means over the blocks too: a neighbour's burst of work
counts alike for all.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...render.aovs import denoising_guides
from ...render.denoise import smoothed
from ...render.passes import Welford
from ...sensor.chain import chain
from ..frames import expected_moments
from ..statistics import Array
from ..subject import Subject
from .per_frame import FEWEST_COMPENSATED, FrameExposure
from .reference import Target, electrons_of
from .series import Series

MOST_BLOCKS = 16
"""Blocks of a size up to which digital numbers are looked at; their moments and frames take as long as a pass."""
MOST_SMOOTHED = 4  # blocks of a size that are denoised
SMOOTHINGS = 3  # pictures that the package smooths: the render, and two halves of it for the bias


@dataclass(frozen=True, eq=False)
class Block:
    """Passes that follow each other, as one render.

    irradiance : mean, (H, W, B) [W m⁻² nm⁻¹], or None.  electrons : mean, (H, W).  squares : Σ (pass − mean)², (H, W).
    """

    passes: int
    seconds: float
    irradiance: NDArray[Any] | None
    electrons: Array
    squares: Any = 0.0

    def __add__(self, other: Block) -> Block:
        """Two blocks of one size as one."""
        both = None if self.irradiance is None else 0.5 * (self.irradiance + other.irradiance)
        squares = self.squares + other.squares + 0.5 * self.passes * (self.electrons - other.electrons) ** 2
        electrons = 0.5 * (self.electrons + other.electrons)
        return Block(2 * self.passes, self.seconds + other.seconds, both, electrons, squares)

    @property
    def variance_e2(self) -> Array:
        """Of the mean electrons, as the passes' spread tells, (H, W)."""
        return np.asarray(self.squares / (self.passes * (self.passes - 1)))


def in_blocks(whole: Callable[[Block], None]) -> Callable[[float, NDArray[Any] | None, Array], None]:
    """Takes passes and joins them into blocks of 1, 2, 4, …; hands each on as it is whole; few are held at a time."""
    waiting: dict[int, Block] = {}

    def take(seconds: float, irradiance: NDArray[Any] | None, electrons: Array) -> None:
        block = Block(1, seconds, irradiance, electrons)
        whole(block)
        while (first := waiting.pop(block.passes, None)) is not None:
            block = first + block
            whole(block)
        waiting[block.passes] = block

    return take


class Rung:
    """All blocks of one size of one run: seconds, squared errors by measure, and frames by what was done with noise."""

    def __init__(self, passes: int) -> None:
        self.passes = passes
        self.seconds: list[float] = []
        self.squares: dict[str, list[float]] = {}
        self.frames: dict[str, Welford] = {}

    def frame(self, treatment: str, digital: NDArray[Any]) -> None:
        """The frame of one block."""
        self.frames.setdefault(treatment, Welford(digital.shape)).add(digital.astype(np.float64))

    def to_dict(self, shown: NDArray[np.bool_]) -> dict[str, Any]:
        """Means of seconds and squared errors, and the variance [DN²] between frames of the pixels ``shown``."""
        drawn = {name: one for name, one in self.frames.items() if one.count > 1}
        return {
            "passes": self.passes,
            "blocks": len(self.seconds),
            "seconds": statistics.fmean(self.seconds),
            **{name: float(np.mean(squares)) for name, squares in self.squares.items()},
            "frames": {name: float(one.variance_of_mean[shown].mean()) * one.count for name, one in drawn.items()},
        }


@dataclass(eq=False)
class Run:
    """The errors of one run. number : its seed.  passes : of it.  framed : at which exposure frames are made, or None.

    smooth : whether the blocks are denoised too.
    """

    subject: Subject
    series: Series
    target: Target
    number: int
    passes: int
    framed: FrameExposure | None = None
    smooth: bool = False

    def measure(self) -> dict[str, list[dict[str, Any]]]:
        """Rungs of every treatment, the shortest first."""
        self._guides = denoising_guides(self.series.scene) if self.smooth else None
        self._rungs: dict[str, dict[int, Rung]] = {"plain": {}, "denoised": {}}
        self._made = 0
        self.series.each_pass(self.number, self.passes, in_blocks(self._block))
        shown = self.target.scale.seen if self.framed is None else self.framed.shown(self.target)
        return {
            treatment: [rungs[passes].to_dict(shown) for passes in sorted(rungs)]
            for treatment, rungs in self._rungs.items()
            if rungs
        }

    def _block(self, block: Block) -> None:
        """One block, and what the denoiser makes of it."""
        count = self._errors("plain", block)
        if self._guides is not None and block.irradiance is not None and count <= MOST_SMOOTHED:
            began = time.perf_counter()
            smooth = smoothed(block.irradiance, self._guides).astype(np.float64)
            seconds = block.seconds + SMOOTHINGS * (time.perf_counter() - began)
            electrons = electrons_of(self.series.layers.light(smooth, block.electrons), self.subject)
            self._errors("denoised", replace(block, seconds=seconds, irradiance=smooth, electrons=electrons))

    def _errors(self, treatment: str, block: Block) -> int:
        """Returns how many blocks of this size there are now."""
        rung = self._rungs[treatment].setdefault(block.passes, Rung(block.passes))
        rung.seconds.append(block.seconds)
        off = {"electrons": block.electrons - self.target.electrons}
        if block.irradiance is not None:
            off["irradiance"] = block.irradiance - self.target.irradiance
        if block.passes * MOST_BLOCKS >= self.passes:
            photons, camera = self.series.layers.light(block.irradiance, block.electrons), self.subject.camera
            off["dn"] = expected_moments(chain(camera), photons, self.subject.exposure)[0] - self.target.mean_dn
            if self.framed is not None and FEWEST_COMPENSATED <= block.passes < self.passes:
                self._made += 1
                rung.frame(treatment, self.framed.frame(camera, photons, self.number, self._made))
                bursts = camera.quantum_efficiency.quantum_yield  # of electrons, whose noise is not Poisson's
                if treatment == "plain" and not bursts:  # the same random bits on one sensor
                    noise = replace(photons, variance_e2=block.variance_e2)
                    rung.frame("compensated", self.framed.frame(camera, noise, self.number, self._made))
        for measure, values in off.items():
            rung.squares.setdefault(measure, []).append(self.target.scale.mean_square(measure, values))
        return len(rung.seconds)
