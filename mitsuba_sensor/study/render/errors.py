"""What a render got wrong: of irradiance, of electrons, of the mean and the temporal σ of the digital numbers.

A run of passes is cut into all its blocks of 1, 2, 4, … of them. Each block is a render of its own, and all of one size
are judged together, so that a rare bright path counts alike in blocks of every size; what is left to chance in a slope
is only how the errors of different passes happen to line up. Seconds are means over the blocks too: a neighbour's burst
of work counts alike for all.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.signals import Photons
from ...render.aovs import guides_of
from ...render.denoise import smoothed
from ...render.passes import Welford
from .frames import FEWEST_SPENT, Framed
from .reference import Truth, electrons_of, mean_and_variance_dn2, photons_of
from .series import Opened, Subject

MOST_BLOCKS = 16
"""Blocks of a size up to which digital numbers are looked at; their moments and frames take as long as a pass."""
MOST_SMOOTHED = 4
"""Blocks of a size that are denoised."""
SMOOTHINGS = 3
"""Pictures that the product smooths: the render, and two halves of it for the bias."""


@dataclass(frozen=True, eq=False)
class Block:
    """Passes that follow each other, as one render.

    irradiance : mean, (H, W, B) [W m⁻² nm⁻¹], or None.  electrons : mean, (H, W).  squares : Σ (pass − mean)², (H, W).
    """

    passes: int
    seconds: float
    irradiance: NDArray[Any] | None
    electrons: NDArray[np.float64]
    squares: Any = 0.0

    def __add__(self, other: Block) -> Block:
        """Two blocks of one size as one."""
        both = None if self.irradiance is None else 0.5 * (self.irradiance + other.irradiance)
        between = 0.5 * self.passes * (self.electrons - other.electrons) ** 2
        return Block(
            2 * self.passes,
            self.seconds + other.seconds,
            both,
            0.5 * (self.electrons + other.electrons),
            self.squares + other.squares + between,
        )

    @property
    def variance_e2(self) -> NDArray[np.float64]:
        """Of the mean electrons, as the passes' spread tells, (H, W)."""
        return np.asarray(self.squares / (self.passes * (self.passes - 1)))


class Blocks:
    """Joins passes into blocks of 1, 2, 4, … and hands each on as it is whole; few are held at a time."""

    def __init__(self, whole: Callable[[Block], None]) -> None:
        self._whole, self._waiting = whole, dict[int, Block]()

    def take(self, seconds: float, irradiance: NDArray[Any] | None, electrons: NDArray[np.float64]) -> None:
        """One pass more."""
        block = Block(1, seconds, irradiance, electrons)
        self._whole(block)
        while (first := self._waiting.pop(block.passes, None)) is not None:
            block = first + block
            self._whole(block)
        self._waiting[block.passes] = block


class Rung:
    """All blocks of one size of one run."""

    def __init__(self, passes: int, shape: tuple[int, int]) -> None:
        self.passes, self._shape = passes, shape
        self.seconds: list[float] = []
        self.squares: dict[str, list[float]] = {}
        self.frames: dict[str, Welford] = {}

    def error(self, measure: str, square: float) -> None:
        """The squared error of one block."""
        self.squares.setdefault(measure, []).append(square)

    def frame(self, treatment: str, digital: NDArray[Any]) -> None:
        """The frame of one block."""
        self.frames.setdefault(treatment, Welford(self._shape)).add(digital.astype(np.float64))

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


@dataclass(frozen=True)
class Run:
    """One run. number : its seed.  framed : at which exposure frames are drawn, or None.  smooth : whether the blocks
    are denoised too."""

    number: int
    passes: int
    framed: Framed | None = None
    smooth: bool = False


class Judge:
    """Judges the blocks of one run.

    subject : what is rendered.  opened : how.  truth : what it is held against.
    """

    def __init__(self, subject: Subject, opened: Opened, truth: Truth, plan: Run) -> None:
        self._subject, self._layers, self._truth, self._shape = subject, opened.layers, truth, opened.shape
        self._passes, self._run, self._framed = plan.passes, plan.number, plan.framed
        self._guides = guides_of(opened.job.scene) if plan.smooth else None
        self._rungs: dict[str, dict[int, Rung]] = {"plain": {}, "denoised": {}}
        self._drawn = 0

    def block(self, block: Block) -> None:
        """One block, and what the denoiser makes of it."""
        count = self._judged("plain", block)
        if self._guides is not None and block.irradiance is not None and count <= MOST_SMOOTHED:
            began = time.perf_counter()
            smooth = smoothed(block.irradiance, self._guides).astype(np.float64)
            seconds = block.seconds + SMOOTHINGS * (time.perf_counter() - began)
            electrons = electrons_of(photons_of(self._subject, self._layers, smooth, block.electrons), self._subject)
            self._judged("denoised", replace(block, seconds=seconds, irradiance=smooth, electrons=electrons))

    def _judged(self, treatment: str, block: Block) -> int:
        """Returns how many blocks of this size there are now."""
        rung = self._rungs[treatment].setdefault(block.passes, Rung(block.passes, self._shape))
        truth, scale = self._truth, self._truth.scale
        rung.seconds.append(block.seconds)
        rung.error("electrons", scale.of_electrons((block.electrons - truth.electrons) ** 2))
        if block.irradiance is not None:
            rung.error("irradiance", scale.of_irradiance((block.irradiance - truth.irradiance) ** 2))
        if block.passes * MOST_BLOCKS >= self._passes:
            photons = photons_of(self._subject, self._layers, block.irradiance, block.electrons)
            mean, _ = mean_and_variance_dn2(photons, self._subject.camera, self._subject.exposure)
            rung.error("dn", scale.of_dn((mean - truth.mean_dn) ** 2))
            if self._framed is not None and FEWEST_SPENT <= block.passes < self._passes:
                self._draw(self._framed, rung, treatment, block, photons)
        return len(rung.seconds)

    def _draw(self, framed: Framed, rung: Rung, treatment: str, block: Block, photons: Photons) -> None:
        """A frame as it is, and one that spends the render's noise: the same words, one device."""
        self._drawn += 1
        camera = self._subject.camera
        rung.frame(treatment, framed.frame(camera, photons, self._run, self._drawn))
        if treatment == "plain" and not camera.quantum_efficiency.quantum_yield:  # whose electrons come in bursts
            rung.frame("spend", framed.frame(camera, photons, self._run, self._drawn, block.variance_e2))

    def to_dict(self) -> dict[str, list[dict[str, Any]]]:
        """Rungs of every treatment, the shortest first."""
        shown = self._truth.scale.seen if self._framed is None else self._framed.shown(self._truth)
        return {
            treatment: [rungs[passes].to_dict(shown) for passes in sorted(rungs)]
            for treatment, rungs in self._rungs.items()
            if rungs
        }
