"""The settings that are compared: ways to render a scene, ways to make its frames, and the laws of their counts.

A count is a function of 32 random bits that falls as their number rises: the share of the 2³² numbers that draw more
than n is where n + 1 turns into n, found by bisection; rounding to float32 moves no result by more than 2 % (tests).
"""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.stats import poisson

from ...core import Float64Array, InputError, NumpyArray, Photons, arrays, types
from ...core.backend import Backend
from ...core.llvm import backend_problem
from ...render.light.bands import GROUP, NARROWEST_NM, Bands
from ...render.light.photons import photons_per_irradiance
from ...render.passes.passes import SAMPLER, hashed_seed
from ...render.passes.prepared import PreparedRender
from ...render.passes.renderer import Renderer
from ...render.passes.row_strip import Kept
from ...render.passes.stop_criterion import PASS_SPP, StopCriterion
from ...render.variants import Variant, choose_variant, mitsuba
from ...sensor.run import choose_backend
from ..frames import BACKENDS
from ..kit import Array, Subject

OTHERS = {"independent": 16, "stratified": 16, "orthogonal": 25, "ldsampler": 16}  # samples that each keeps
SIZES = (4, 64, 256)  # samples per pass beside the package's first 16 (render/passes/stop_criterion.py)
EXACT, QUANTILE, GAUSSIAN, MEAN_ONLY, GENERATOR = "exact", "quantile", "Gaussian", "mean only", "NumPy Generator"
SAMPLERS = (EXACT, QUANTILE, GAUSSIAN, MEAN_ONLY, GENERATOR)
OWN = SAMPLERS[:2]  # what the package offers: in float64 SciPy's exact quantile, in float32 its own quantile function
NUMBERS = 2**32

Law = dict[str, float | None]
"""Against Poisson's of the same mean: "variation", ½Σ|p − q|; "resolution", below which that cannot be told from 0;
relative errors of "mean", "variance" and "skewness", which of a single value is None."""


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
        return f"--spp {self.spp} --spectral {self.spectral}{'' if self.denoise else ' --no-denoise'}{variant}"


class Series:
    """A setting with its scene loaded, nothing compiled; let the one before go first, or it slows Mitsuba's kernels.

    groups : of bands rendered apart.  shape : (rows, columns)."""

    def __init__(self, subject: Subject, setting: RenderSetting) -> None:
        self.setting, self.loop = setting, setting.banding == "loop"
        self._loaded = partial(subject.job_with, sampler=setting.sampler, variant=setting.variant)
        self.job = job = self._loaded(spectral="auto" if self.loop else setting.banding)
        self.bands, self.groups = job.bands, len(job.bands if self.loop else job.bands.groups)
        self.shape, self._origin = job.scene.view.crop_size[::-1], job.scene.view.crop_offset[::-1]
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

    def denoised(self, seed: int, count: int) -> Block:
        """A render of so many passes with the package's denoiser, and the time of both."""
        began, job = time.perf_counter(), self.job
        renderer = Renderer(job.scene, job.camera, job.exposure, job.bands, Kept.HALVES)
        criterion = StopCriterion(count, self.setting.samples, grouped=self.groups > 1)
        light = replace(job, denoise=True, renderer=renderer).render(hashed_seed(seed, count, 1), criterion)
        return Block(count, time.perf_counter() - began, light.data.astype(np.float64), renderer.electrons()[0])


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
        of = [f"{backend}_" for backend in ("cuda", "llvm", "scalar") if backend_problem(backend) is None]
        asked = [name for own in of for name in there if name.startswith(own) and name.endswith("_spectral")]
    return tuple(dict.fromkeys(map(choose_variant, asked)))


def all_settings(base: RenderSetting, variants: Sequence[Variant], bands: Bands, channels: bool) -> list[RenderSetting]:
    """What is compared, ``base`` first: one factor at a time. bands : of ``base``.  channels : whether these may be."""
    separate = len(bands) > 1 and bands.bandwidths_nm.min() >= NARROWEST_NM
    bandings = {"cube": len(bands) > GROUP, "channels": channels, "loop": separate}
    return [
        base,
        *(base._replace(sampler=sampler, samples=samples) for sampler, samples in OTHERS.items()),
        *(base._replace(samples=samples) for samples in SIZES),
        *(base._replace(variant=variant.name) for variant in variants[1:]),
        *(base._replace(banding=banding) for banding, usable in bandings.items() if usable),
    ]


class FrameSetting(NamedTuple):
    """One way to make frames. tolerance_dn : of the plan [DN], or None for the whole chain."""

    engine: str
    precision: str
    sampler: str
    tolerance_dn: float | None = None

    @property
    def name(self) -> str:
        """For measurements, tables and people."""
        plan = "" if self.tolerance_dn is None else f", plan {self.tolerance_dn:g} DN"
        return f"{self.engine} {self.precision}, {self.sampler}{plan}"

    @property
    def compiled(self) -> bool:
        """Whether a kernel makes the frames."""
        return self.engine in BACKENDS

    def backend(self) -> Backend:
        """Who does the arithmetic, with the sampler's law in the place of the engine's own."""
        own = choose_backend(self.engine, self.precision, 0)
        if self.sampler in OWN:
            return own
        other = copy.copy(own)  # all that is not counted keeps its bits
        other.poisson = partial(DRAWN[self.sampler], own)  # type: ignore[method-assign]
        return other


REFERENCE = FrameSetting("numpy", "float64", EXACT)  # all others are compared with it: whole chain, every law exact


def gaussian(backend: Backend, bits: types.Array, mean: types.Array) -> types.Array:
    """round(λ + √λ·z), not below 0: what many simulators do."""
    return arrays.maximum(arrays.floor(mean + arrays.sqrt(mean) * backend.normal(bits) + 0.5), 0.0)


def generator(backend: Backend, bits: types.Array, mean: types.Array) -> types.Array:
    """NumPy's ``Generator.poisson``, a third party: exact by rejection, and with a state."""
    random = np.random.default_rng(bits.ravel()[:4])  # so a frame can be made again, but a crop is not the frame's crop
    return random.poisson(np.minimum(mean, 9.2e18), bits.shape).astype(np.float32)  # int64 counts no more


DRAWN = {GAUSSIAN: gaussian, MEAN_ONLY: lambda backend, bits, mean: mean, GENERATOR: generator}


def drawn_law(setting: FrameSetting, mean: float) -> Law:
    """The law that a sampler draws at a mean [events], rounded to float32: every engine is given the same."""
    exact, backend = float(np.float32(mean)), setting.backend()
    if setting.sampler != GENERATOR:
        return law_of(lambda bits: counts_of(backend, bits, exact), exact)
    bits = np.random.default_rng(1).integers(0, NUMBERS, 2**21, dtype=np.uint32)
    return law_of_counts(counts_of(backend, bits, exact), exact)


def counts_of(backend: types.Array, bits: types.RandomBits, mean: float) -> Array:
    """What a line of random bits (N,) draws from one mean, on whichever :class:`Backend`."""
    counts = backend.poisson(backend.uint(bits) if backend.compiled else bits, backend.number(mean))
    return np.broadcast_to(np.asarray(counts, dtype=np.float64), bits.shape)


def law_of(draw: Callable[[types.RandomBits], Array], mean: float) -> Law:
    """The law of all random bits. ``draw`` must not rise with them; ``mean`` is the λ that it was given [events]."""
    highest, lowest = (float(x) for x in draw(np.array([0, NUMBERS - 1], dtype=np.uint32)))
    if highest == lowest:
        return compared(np.array([lowest]), np.ones(1), mean, 0.0)
    n = np.arange(lowest, highest + 1)
    low, high = np.zeros(n.size - 1, dtype=np.int64), np.full(n.size - 1, NUMBERS - 1, dtype=np.int64)
    while (low < high).any():  # the first number that draws n or less: as many numbers draw more
        middle = (low + high) // 2
        there = draw(middle.astype(np.uint32)) <= n[:-1]
        low, high = np.where(there, low, np.minimum(middle + 1, high)), np.where(there, middle, high)
    at_most = np.append(1 - low / NUMBERS, 1.0)
    return compared(n, np.diff(at_most, prepend=0.0), mean, n.size / NUMBERS)


def law_of_counts(counts: Array, mean: float) -> Law:
    """The law that so many independent draws show; the resolution is what as many exact ones would show by chance."""
    n, seen = np.unique(counts, return_counts=True)
    q = poisson.pmf(np.arange(n[0], n[-1] + 1), mean)
    by_chance = 0.5 * float(np.sqrt(2 / np.pi * q * (1 - q) / counts.size).sum())
    return compared(n, seen / counts.size, mean, by_chance)


def compared(n: Array, share: Array, mean: float, resolution: float) -> Law:
    """The law that takes each ``n`` with this ``share``, all of which add up to 1, against Poisson's."""
    exact = poisson.pmf(n, mean)  # 0 where n is no whole number
    variation = 0.5 * float(np.abs(share - exact).sum() + 1 - exact.sum())
    shift = float(np.sum(share * (n - mean)))
    second, third = (float(np.sum(share * (n - mean - shift) ** k)) for k in (2, 3))
    skewness = third / second**1.5 * mean**0.5 - 1 if second > 0 else None
    known = {"variation": variation, "resolution": resolution, "mean": shift / mean, "variance": second / mean - 1}
    return {**known, "skewness": skewness}
