"""One way to render a scene, opened, with its passes timed one by one.

What is compared changes one thing at a time about what the product does by itself: sampler, samples per pass, variant,
or how the bands share light paths.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.exposure import Exposure
from ...render.bands import GROUP, NARROWEST_NM, Bands
from ...render.irradiance import Job, RenderOptions, prepare
from ...render.lint import SAMPLER
from ...render.passes import hashed_seed
from ...render.stop_criterion import PASS_SPP, StopCriterion
from ...render.variants import Variant, choose_variant, mitsuba

if TYPE_CHECKING:
    from ...sensor.camera import Camera

Banding = Literal["auto", "cube", "channels", "loop"]
SAMPLERS = {"independent": 16, "stratified": 16, "orthogonal": 25, "ldsampler": 16}
"""Mitsuba's others, with a number of samples per pass that each keeps: orthogonal wants the square of a prime."""
SIZES = (4, 64, 256)
"""Samples per pass beside the product's first 16 (render/stop_criterion.py)."""
ORDER = ("cuda", "llvm", "scalar")
"""Of the back ends, the quickest first, as :func:`render.variants.choose_variant` has it."""

FrameOfRender = Callable[[float, NDArray[np.float64] | None, NDArray[np.float64]], None]
"""What is called with every pass: its seconds, its irradiance (H, W, B) or None, its electrons (H, W)."""


@dataclass(frozen=True)
class Setting:
    """One way to render.

    banding : "auto", "cube" or "channels" as in :func:`render.irradiance.render`; "loop", one render per band.
    """

    variant: str
    sampler: str = SAMPLER
    samples: int = PASS_SPP
    banding: Banding = "auto"

    @property
    def key(self) -> str:
        """All of it, for the journal."""
        return f"{self.variant} {self.sampler} {self.samples} {self.banding}"

    def label(self, base: Setting) -> str:
        """What differs from the setting in the middle."""
        own = {
            "variant": self.variant,
            "sampler": self.sampler,
            "samples": f"{self.samples} per pass",
            "banding": {"loop": "band by band"}.get(self.banding, self.banding),
        }
        return ", ".join(own[name] for name in own if getattr(self, name) != getattr(base, name)) or "as shipped"


@dataclass(frozen=True, eq=False)
class Subject:
    """The scene, camera and exposure that are studied; fields as in :func:`render.irradiance.render`."""

    scene: str | os.PathLike[str]
    camera: Camera
    exposure: Exposure
    parameters: Mapping[str, Any] | None = None
    scene_unit: str | float | None = None
    columns: int | None = None

    def job(self, setting: Setting, **options: Any) -> Job:
        """The scene, loaded for a setting. wish : other words of :class:`render.irradiance.RenderOptions`."""
        words = RenderOptions(
            scene_unit=self.scene_unit, columns=self.columns, parameters=self.parameters, variant=setting.variant,
            **options,
        )  # fmt: skip
        return prepare(self.scene, self.camera, self.exposure, words, sampler=setting.sampler)

    def ready(self, setting: Setting) -> Opened:
        """The setting, ready to render; nothing is compiled yet. Let the one before go first: Mitsuba's kernels know
        the materials of every scene that is loaded, and each makes a pass longer."""
        if setting.banding == "loop":
            return BandByBand(self.job(setting, spectral="auto"), setting, self)
        return Opened(self.job(setting, spectral=setting.banding), setting)


@dataclass(frozen=True)
class Layers:
    """What the layers of a picture are.

    wavelengths_nm, bandwidths_nm : of each.  detected : whether they are colour filters, whose electrons are counted.
    origin : (row, column) of the first pixel on the sensor.
    """

    wavelengths_nm: tuple[float, ...]
    bandwidths_nm: tuple[float, ...]
    detected: bool
    origin: tuple[int, int]

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, found: Mapping[str, Any]) -> Layers:
        """What :meth:`to_dict` gave, also after JSON has made lists of its tuples."""
        return cls(
            tuple(found["wavelengths_nm"]), tuple(found["bandwidths_nm"]), found["detected"], tuple(found["origin"])
        )


class Opened:
    """A setting with its scene loaded.

    samples : per pixel, pass and group of bands.  groups : of bands rendered apart.
    shape : (rows, columns).  layers : of its pictures.
    """

    def __init__(self, job: Job, setting: Setting) -> None:
        self.job, self.samples, self.bands = job, setting.samples, job.bands
        (columns, rows), (column, row) = job.scene.view.crop_size, job.scene.view.crop_offset
        self.shape = rows, columns
        centres_nm, widths_nm = (tuple(x.tolist()) for x in (job.bands.wavelengths_nm, job.bands.bandwidths_nm))
        self.layers = Layers(centres_nm, widths_nm, job.bands.kind == "channels", (row, column))
        self.groups = len(job.bands.groups)

    @property
    def samples_per_pass(self) -> int:
        """Light paths per pixel of one pass through all bands."""
        return self.samples * self.groups

    def each_pass(self, seed: int, passes: int, take: FrameOfRender) -> None:
        """Render so many passes; what ``take`` does is on nobody's clock."""
        if self.layers.detected:
            _apart(
                self.job, seed, StopCriterion(passes, self.samples), lambda s, _, electrons: take(s, None, electrons)
            )
        else:
            _apart(self.job, seed, StopCriterion(passes, self.samples, grouped=self.groups > 1), take)

    def warm(self) -> None:
        """Compile, or fetch what is compiled."""
        self.each_pass(0, 1, lambda *_: None)


class BandByBand(Opened):
    """One render per band, one after the other; each scene is let go before the next is loaded."""

    def __init__(self, job: Job, setting: Setting, subject: Subject) -> None:
        super().__init__(job, setting)
        del self.job
        self._subject, self._setting, self.groups = subject, setting, len(self.bands)

    def each_pass(self, seed: int, passes: int, take: FrameOfRender) -> None:
        """As above; all passes of a band are rendered together, as one would, and handed on when all bands are."""
        seconds, electrons = np.zeros(passes), np.zeros((passes, *self.shape))
        layers = np.zeros((passes, *self.shape, len(self.bands)), np.float32)
        for k in range(len(self.bands)):
            band = {"wavelength_nm": self.layers.wavelengths_nm[k], "bandwidth_nm": self.layers.bandwidths_nm[k]}
            try:
                job = self._subject.job(self._setting, **band)
            except InputError:  # no light in this band, which alone is refused: the scene was loaded before
                continue
            number = iter(range(passes))

            def one(pass_s: float, layer: Any, counted: Any, k: int = k, number: Iterator[int] = number) -> None:
                at = next(number)
                seconds[at] += pass_s
                electrons[at] += counted
                layers[at, ..., k] = layer[..., 0]

            _apart(job, 0, StopCriterion(1, self.samples), lambda *_: None)  # compiles
            _apart(job, hashed_seed(seed, k, 0), StopCriterion(passes, self.samples), one)
        for at in range(passes):
            take(float(seconds[at]), layers[at].astype(np.float64), electrons[at])

    def warm(self) -> None:
        """Every band does it anew."""


def _apart(job: Job, seed: int, budget: StopCriterion, take: FrameOfRender) -> None:
    """The product's own render, whose running means are taken apart into passes."""
    renderer, sums = job.renderer, [0.0, 0.0]
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

    renderer.run(seed, budget, lambda step: None, look)


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


def settings(base: Setting, variants: Sequence[Variant], bands: Bands, channels: bool) -> tuple[Setting, ...]:
    """What is compared, ``base`` first: one factor at a time.

    bands : of ``base``.  channels : whether the camera has any.
    """
    bandings: list[Banding] = ["cube"] if len(bands) > GROUP else []
    if channels:
        bandings.append("channels")
    if len(bands) > 1 and bands.bandwidths_nm.min() >= NARROWEST_NM:
        bandings.append("loop")
    return (
        base,
        *(replace(base, sampler=sampler, samples=samples) for sampler, samples in SAMPLERS.items()),
        *(replace(base, samples=samples) for samples in SIZES),
        *(replace(base, variant=variant.name) for variant in variants[1:]),
        *(replace(base, banding=banding) for banding in bandings),
    )
