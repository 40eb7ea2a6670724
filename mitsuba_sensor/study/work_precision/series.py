"""One way to render a scene, loaded, with its passes timed one by one.

What is compared changes one thing at a time about what the package does by itself: sampler, samples per pass, variant,
or how the bands share light paths.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.signals import Photons
from ...render.bands import GROUP, NARROWEST_NM, Bands
from ...render.passes import SAMPLER, hashed_seed
from ...render.photons import photons_per_irradiance
from ...render.prepared import PreparedRender
from ...render.scene import Scene
from ...render.stop_criterion import PASS_SPP, StopCriterion
from ...render.variants import Variant, choose_variant, mitsuba
from ..statistics import Array
from ..subject import Subject

SAMPLERS = {"independent": 16, "stratified": 16, "orthogonal": 25, "ldsampler": 16}
"""Mitsuba's others, with a number of samples per pass that each keeps: orthogonal wants the square of a prime."""
SIZES = (4, 64, 256)  # samples per pass beside the package's first 16 (render/stop_criterion.py)
ORDER = ("cuda", "llvm", "scalar")
"""Of the back ends, the quickest first, as :func:`render.variants.choose_variant` has it."""

Take = Callable[[float, Array | None, Array], None]
"""What is called with every pass: its seconds, its irradiance (H, W, B) or None, its electrons (H, W)."""


@dataclass(frozen=True)
class Setting:
    """One way to render.

    banding : "auto", "cube" or "channels" as in :func:`mitsuba_sensor.render`; "loop", one render per band.
    """

    variant: str
    sampler: str = SAMPLER
    samples: int = PASS_SPP
    banding: str = "auto"

    @property
    def key(self) -> str:
        """All of it, for measurements."""
        return f"{self.variant} {self.sampler} {self.samples} {self.banding}"

    def label(self, base: Setting) -> str:
        """What differs from the base setting."""
        banding = "band by band" if self.banding == "loop" else self.banding
        own = {"variant": self.variant, "sampler": self.sampler, "samples": f"{self.samples} per pass"}
        own["banding"] = banding
        return ", ".join(own[name] for name in own if getattr(self, name) != getattr(base, name)) or "as shipped"


@dataclass(frozen=True, eq=False)
class Layers:
    """What the layers of a picture are.

    wavelengths_nm, photons : (B,), centre of each and photons per irradiance.  detected : whether they are colour
    filters, whose electrons are counted.  origin : (row, column) of the first pixel on the sensor.
    """

    wavelengths_nm: Array
    photons: Array
    detected: bool
    origin: tuple[int, int]

    def light(self, irradiance: NDArray[Any] | None, electrons: Array) -> Photons:
        """The light as :func:`mitsuba_sensor.collect` has it; of channels each pixel's own electrons."""
        if self.detected or irradiance is None:
            mean = np.repeat(electrons[..., None], self.wavelengths_nm.size, axis=-1)
            return Photons(mean, self.wavelengths_nm, detected=True, origin=self.origin)
        return Photons(irradiance * self.photons, self.wavelengths_nm, origin=self.origin)


class Series:
    """A setting with its scene loaded.

    samples : per pixel, pass and group of bands.  groups : of bands rendered apart.
    shape : (rows, columns).  layers : of its pictures.
    """

    def __init__(self, subject: Subject, setting: Setting) -> None:
        self._subject, self._setting, self.samples = subject, setting, setting.samples
        self.job = job = self._loaded(spectral="auto" if setting.banding == "loop" else setting.banding)
        self.bands, self.groups = job.bands, len(job.bands.groups)
        assert isinstance(job.scene, Scene)  # nothing moves
        self.scene = job.scene
        (columns, rows), (column, row) = job.scene.view.crop_size, job.scene.view.crop_offset
        self.shape = rows, columns
        centres_nm, widths_nm = np.array(job.bands.wavelengths_nm), np.array(job.bands.bandwidths_nm)
        photons = photons_per_irradiance(subject.camera, subject.exposure, centres_nm, widths_nm)
        self.layers = Layers(centres_nm, photons, job.bands.kind == "channels", (row, column))

    def _loaded(self, **options: Any) -> PreparedRender:
        return self._subject.job_with(sampler=self._setting.sampler, variant=self._setting.variant, **options)

    @property
    def samples_per_pass(self) -> int:
        """Light paths per pixel of one pass through all bands."""
        return self.samples * self.groups

    def each_pass(self, seed: int, passes: int, take: Take) -> None:
        """Render so many passes; what ``take`` does is not timed."""
        if self.layers.detected:
            one_by_one(self.job, seed, StopCriterion(passes, self.samples), lambda s, _, e: take(s, None, e))
        else:
            one_by_one(self.job, seed, StopCriterion(passes, self.samples, grouped=self.groups > 1), take)

    def warm(self) -> None:
        """Compile, or fetch what is compiled."""
        self.each_pass(0, 1, lambda *_: None)


class BandByBand(Series):
    """One render per band, one after the other; each scene is let go before the next is loaded."""

    def __init__(self, subject: Subject, setting: Setting) -> None:
        super().__init__(subject, setting)
        del self.job, self.scene
        self.groups = len(self.bands)

    def each_pass(self, seed: int, passes: int, take: Take) -> None:
        """All passes of a band are rendered together, as one would, and handed on when all bands are."""
        seconds, electrons = np.zeros(passes), np.zeros((passes, *self.shape))
        layers = np.zeros((passes, *self.shape, len(self.bands)), np.float32)
        for k in range(len(self.bands)):
            centre, width = float(self.bands.wavelengths_nm[k]), float(self.bands.bandwidths_nm[k])
            try:
                job = self._loaded(spectral="auto", wavelength_nm=centre, bandwidth_nm=width)
            except InputError:  # no light in this band, which alone is refused: the scene was loaded before
                continue
            number = iter(range(passes))

            def one(pass_s: float, layer: Any, counted: Array, k: int = k, number: Iterator[int] = number) -> None:
                at = next(number)
                seconds[at] += pass_s
                electrons[at] += counted
                layers[at, ..., k] = layer[..., 0]

            one_by_one(job, 0, StopCriterion(1, self.samples), lambda *_: None)  # compiles
            one_by_one(job, hashed_seed(seed, k, 0), StopCriterion(passes, self.samples), one)
        for at in range(passes):
            take(float(seconds[at]), layers[at].astype(np.float64), electrons[at])

    def warm(self) -> None:
        """Every band does it anew."""


def loaded(subject: Subject, setting: Setting) -> Series:
    """The setting, ready to render; nothing is compiled yet.

    Let the one before go first: Mitsuba's kernels know the materials of every scene that is loaded, and each makes a
    pass longer.
    """
    return (BandByBand if setting.banding == "loop" else Series)(subject, setting)


def one_by_one(job: PreparedRender, seed: int, criterion: StopCriterion, take: Take) -> None:
    """The package's own render, whose running means are taken apart into passes."""
    renderer, sums = job.renderer, list[Any]([0.0, 0.0])
    began = time.perf_counter()

    def look(*_: Any) -> float:
        nonlocal began
        seconds = time.perf_counter() - began
        means = np.concatenate([strip.bands.mean for strip in renderer.strips]), renderer.electrons()[0]
        now = [mean * renderer.passes for mean in means]
        irradiance, electrons = (np.maximum(new - old, 0.0) for new, old in zip(now, sums, strict=True))
        sums[:] = now  # the maximum is for rounding: −1e-20 of 1e-5
        take(seconds, irradiance, electrons)
        began = time.perf_counter()
        return 1.0

    renderer.run(seed, criterion, lambda step: None, look)


def usable_variants(asked: Sequence[str] | None) -> tuple[Variant, ...]:
    """The variants that are asked for, else all spectral ones that work here, the quickest first. Raises InputError."""
    if asked is not None:
        if isinstance(asked, str) or not asked:
            raise InputError(f"variants is {asked!r}; pass a list of names, e.g. ['scalar_spectral'], or None for all.")
        return tuple(dict.fromkeys(choose_variant(name) for name in asked))
    found = []
    for name in mitsuba().variants():
        if name.endswith("_spectral"):
            try:
                found.append(choose_variant(name))
            except InputError:  # its back end is not there
                continue
    return tuple(sorted(found, key=lambda variant: (ORDER.index(variant.backend), "_ad_" in variant.name)))


def all_settings(base: Setting, variants: Sequence[Variant], bands: Bands, channels: bool) -> tuple[Setting, ...]:
    """What is compared, ``base`` first: one factor at a time. bands : of ``base``.  channels : whether these may be."""
    separate = len(bands) > 1 and bands.bandwidths_nm.min() >= NARROWEST_NM
    there = {"cube": len(bands) > GROUP, "channels": channels, "loop": separate}
    return (
        base,
        *(replace(base, sampler=sampler, samples=samples) for sampler, samples in SAMPLERS.items()),
        *(replace(base, samples=samples) for samples in SIZES),
        *(replace(base, variant=variant.name) for variant in variants[1:]),
        *(replace(base, banding=banding) for banding, usable in there.items() if usable),
    )
