"""Ways to render a scene, each in one thing off what the package does by itself, and a scene loaded in one of them."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from ...core import Float64Array, InputError, NumpyArray, Photons
from ...core.llvm import backend_problem
from ...render.bands import GROUP, NARROWEST_NM, Bands
from ...render.passes import SAMPLER, hashed_seed
from ...render.photons import photons_per_irradiance
from ...render.prepared import PreparedRender
from ...render.stop_criterion import PASS_SPP, StopCriterion
from ...render.variants import Variant, choose_variant, mitsuba
from ..kit import Subject

SAMPLERS = {"independent": 16, "stratified": 16, "orthogonal": 25, "ldsampler": 16}
"""Mitsuba's others, with a number of samples per pass that each keeps: orthogonal wants the square of a prime."""
SIZES = (4, 64, 256)  # samples per pass beside the package's first 16 (render/stop_criterion.py)
ORDER = ("cuda", "llvm", "scalar")  # of the back ends, the quickest first, as render.variants.choose_variant has it


class RenderSetting(NamedTuple):
    """One way to render; as text, which measurements are named by, all of it."""

    variant: str
    sampler: str = SAMPLER
    samples: int = PASS_SPP
    banding: str = "auto"  # or "cube" or "channels" as in :func:`mitsuba_sensor.render`; "loop", one render per band

    def __str__(self) -> str:
        return " ".join(map(str, self))

    def label(self, base: RenderSetting) -> str:
        """What differs from the base setting."""
        banding = "band by band" if self.banding == "loop" else self.banding
        texts = self.variant, self.sampler, f"{self.samples} per pass", banding
        off = [text for text, mine, other in zip(texts, self, base, strict=True) if mine != other]
        return ", ".join(off) or "as shipped"


class Choice(NamedTuple):
    """Options of ``mitsuba-sensor render``, and what they are expected to give."""

    spectral: str
    spp: int
    denoise: bool
    variant: str
    usual: bool  # whether the variant is the one that is taken by itself, and need not be named
    seconds: float  # predicted
    error: float  # predicted; relative rms error of the electrons

    @property
    def options(self) -> str:
        """As they are typed."""
        variant = "" if self.usual else f" --variant {self.variant}"
        return f"--spp {self.spp} --spectral {self.spectral}{' --denoise' if self.denoise else ''}{variant}"


class Series:
    """A setting with its scene loaded, nothing compiled. groups : of bands rendered apart.  shape : (rows, columns).

    Let the one before go first: Mitsuba's kernels know the materials of every loaded scene, each makes a pass longer.
    """

    def __init__(self, subject: Subject, setting: RenderSetting) -> None:
        self.setting, self.loop = setting, setting.banding == "loop"
        self._loaded = partial(subject.job_with, sampler=setting.sampler, variant=setting.variant)
        self.job = job = self._loaded(spectral="auto" if self.loop else setting.banding)
        self.bands, self.groups = job.bands, len(job.bands if self.loop else job.bands.groups)
        (columns, rows), (column, row) = job.scene.view.crop_size, job.scene.view.crop_offset
        self.shape, self._origin = (rows, columns), (row, column)
        self._centres_nm, widths_nm = np.array(job.bands.wavelengths_nm), np.array(job.bands.bandwidths_nm)
        self._photons = photons_per_irradiance(subject.camera, subject.exposure, self._centres_nm, widths_nm)
        if self.loop:
            del self.job

    def light(self, irradiance: NumpyArray, electrons: Float64Array) -> Photons:
        """The light as :func:`mitsuba_sensor.collect` has it; of channels each pixel's own electrons."""
        detected, centres_nm = self.bands.kind == "channels", self._centres_nm
        mean = np.repeat(electrons[..., None], centres_nm.size, axis=-1) if detected else irradiance * self._photons
        return Photons(mean, centres_nm, detected=detected, origin=self._origin)

    def passes(self, seed: int, count: int) -> Iterator[Block]:
        """Renders of one pass each; what is done between them is not timed."""
        criterion = StopCriterion(count, self.setting.samples, grouped=self.groups > 1 and not self.loop)
        if not self.loop:
            yield from one_by_one(self.job, seed, criterion)
            return
        shape = *self.shape, len(self.bands)
        blocks = [Block(1, 0.0, np.zeros(shape), np.zeros(self.shape)) for _ in range(count)]
        for k in range(len(self.bands)):  # all passes of a band; its scene is let go before the next is loaded
            centre, width = float(self.bands.wavelengths_nm[k]), float(self.bands.bandwidths_nm[k])
            try:
                job = self._loaded(spectral="auto", wavelength_nm=centre, bandwidth_nm=width)
            except InputError:  # no light in this band, which alone is refused: the scene was loaded before
                continue
            list(one_by_one(job, 0, replace(criterion, passes=1)))  # compiles
            for block, one in zip(blocks, one_by_one(job, hashed_seed(seed, k, 0), criterion), strict=True):
                block.seconds += one.seconds
                block.irradiance[..., k] = one.irradiance[..., 0]
                block.electrons += one.electrons
        yield from blocks


@dataclass(eq=False)
class Block:
    """Passes that follow each other, as one render."""

    passes: int
    seconds: float
    irradiance: NumpyArray  # mean, (H, W, B) [W m⁻² nm⁻¹]
    electrons: Float64Array  # mean, (H, W)
    squares: Float64Array | float = 0.0  # Σ (pass − mean)², (H, W)

    def __add__(self, other: Block) -> Block:
        """Two blocks of one size as one."""
        squares = self.squares + other.squares + 0.5 * self.passes * (self.electrons - other.electrons) ** 2
        means = 0.5 * (self.irradiance + other.irradiance), 0.5 * (self.electrons + other.electrons)
        return Block(2 * self.passes, self.seconds + other.seconds, *means, squares)


def one_by_one(job: PreparedRender, seed: int, criterion: StopCriterion) -> Iterator[Block]:
    """Renders of one pass each, with seeds of their own."""
    for k in range(criterion.passes):
        began = time.perf_counter()
        job.renderer.run(hashed_seed(seed, k, 0), replace(criterion, passes=1), lambda step: None)
        seconds, electrons = time.perf_counter() - began, job.renderer.electrons()[0]
        yield Block(1, seconds, np.concatenate([strip.bands.mean for strip in job.renderer.strips]), electrons)


def in_blocks(passes: Iterable[Block]) -> Iterator[Block]:
    """All blocks of 1, 2, 4, … passes, each as soon as it is whole; few are held at a time."""
    waiting: dict[int, Block] = {}
    for block in passes:
        yield block
        while (first := waiting.pop(block.passes, None)) is not None:
            block = first + block
            yield block
        waiting[block.passes] = block


def usable_variants(asked: Sequence[str] | None) -> tuple[Variant, ...]:
    """The variants that are asked for, else all spectral ones that work here, the quickest first. Raises InputError."""
    if isinstance(asked, str) or (asked is not None and not asked):
        raise InputError(f"variants is {asked!r}; pass a list of names, e.g. ['scalar_spectral'], or None for all.")
    if asked is None:
        there = sorted(mitsuba().variants(), key=lambda name: "_ad_" in name)
        of = [f"{backend}_" for backend in ORDER if backend_problem(backend) is None]
        asked = [name for own in of for name in there if name.startswith(own) and name.endswith("_spectral")]
    return tuple(dict.fromkeys(map(choose_variant, asked)))


def all_settings(base: RenderSetting, variants: Sequence[Variant], bands: Bands, channels: bool) -> list[RenderSetting]:
    """What is compared, ``base`` first: one factor at a time. bands : of ``base``.  channels : whether these may be."""
    separate = len(bands) > 1 and bands.bandwidths_nm.min() >= NARROWEST_NM
    bandings = {"cube": len(bands) > GROUP, "channels": channels, "loop": separate}
    return [
        base,
        *(base._replace(sampler=sampler, samples=samples) for sampler, samples in SAMPLERS.items()),
        *(base._replace(samples=samples) for samples in SIZES),
        *(base._replace(variant=variant.name) for variant in variants[1:]),
        *(base._replace(banding=banding) for banding, usable in bandings.items() if usable),
    ]
