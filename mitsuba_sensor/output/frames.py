"""Frames: raw frames with their expected values, report, notes and files."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from ..camera.dual_pixels import has_several_readouts
from ..camera.figures import refuse_readouts
from ..camera.readouts import unknown_readout
from ..core import Exposure, InputError, by_weight
from ..core.checks import require_path
from ..core.plots import labelled_axes
from ..files.texts import write_page
from ..render.light.light_source import CollectedLight
from ..render.light.photons import photons_of
from ..sensor.expose import PreparedExposure
from ..sensor.frame_notes import exposure_notes as notes_of_exposure
from ..sensor.frames import KEEP, RawFrames
from ..sensor.readouts import exposures_of_readouts
from ..stages.usual_range import temperature_note
from ..theory.clean import PixelMoments, pixel_moments
from ..theory.expected import Expectation
from ..theory.noise_budget import NoiseBudget
from ..theory.plan import Plan
from ..theory.report import report
from .dng import write_dng
from .frame_files import frames_html, preview_of, save_frames
from .frame_page import frame_page

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..render.light.irradiance import Irradiance

SERIALS = 32
"""Sensor units whose clean frames are averaged."""
PLOTTED_BINS = 256


class FramesOfReadouts(dict[str, "Frames"]):
    """Frames by the name of their readout; another name raises InputError."""

    def __init__(self, camera: str, frames: Mapping[str, Frames]) -> None:
        super().__init__(frames)
        self.camera = camera

    def __missing__(self, name: str) -> NoReturn:
        raise unknown_readout(self.camera, name, self)


@dataclass(frozen=True, eq=False, repr=False)
class Frames(RawFrames):
    """Raw frames of one camera, with their expected values and files.

    ::

        frames = ms.expose(photons, camera, exposure, frames=2)
        difference = frames.digital[0] - frames.clean  # temporal noise only [DN]
        print(frames.noise_budget().explain())
        frames.save("frames/")

    digital : (N, H, W) uint8, uint16 or uint32, whichever holds ``adc.bits`` [DN].
    plan : stages omitted from the chain, if ``plan`` or ``tolerance_dn`` was given.
    detected : mean photoelectrons of the light.  backend : backend that computed the frames.
    photons, photoelectrons, dark_electrons, electrons, volts, input_referred_electrons : (N, H, W) float64 if requested
        with ``keep``, else None.
    own_clean, own_readouts : clean frames and readouts, if each frame has separate light.
    """

    plan: Plan | None = None
    own_clean: NDArray[np.float32] | None = None
    own_readouts: Mapping[str, Frames] | None = None

    @classmethod
    def of(cls, raw: RawFrames) -> Frames:
        """Return frames with these digital numbers."""
        return cls(**{field.name: getattr(raw, field.name) for field in fields(RawFrames)})

    def __sub__(self, other: object) -> NoReturn:
        raise InputError(
            "Frames is not an array; frames.minus(dark) subtracts a bias frame, and frames.digital.astype(float) is an "
            "array for calculations."
        )

    __rsub__ = __add__ = __radd__ = __mul__ = __rmul__ = __truediv__ = __rtruediv__ = __sub__
    __array_ufunc__ = None

    @classmethod
    def exposed(cls, sensor: PreparedExposure) -> Frames:
        """Return all frames of an exposure."""
        return cls.of(sensor.frames())

    @classmethod
    def joined(cls, parts: Sequence[Frames], with_clean: bool) -> Frames:
        """Join frames that each have separate light; light, theory and report are those of the first frame.

        with_clean : also compute the clean frame of each.
        """
        first, joined = parts[0], dict[str, Any]()
        for name in ("digital", *KEEP):
            if getattr(first, name) is not None:
                joined[name] = np.concatenate([getattr(part, name) for part in parts])
        clean = np.concatenate([part.clean_of_each for part in parts]) if with_clean else None
        readouts = None
        if has_several_readouts(first.camera):
            by_name = {
                name: cls.joined([part.readouts[name] for part in parts], False)
                for name in first.readouts
            }
            readouts = FramesOfReadouts(first.camera.name, by_name)
        return replace(first, **joined, own_clean=clean, own_readouts=readouts)

    @cached_property
    def readouts(self) -> Mapping[str, Frames]:
        """Frames of each combined readout, or of the left and right photodiodes of dual pixels, by name; empty for a
        camera with one readout.

        They are computed on demand, with the bytes that were combined. Photodiodes of dual pixels have the electrons
        whose sum is the image, read separately.
        """
        if self.own_readouts is not None:
            return self.own_readouts
        exposures = exposures_of_readouts(self)
        frames = {name: Frames.exposed(exposure) for name, exposure in exposures.items()}
        return FramesOfReadouts(self.camera.name, frames)

    @cached_property
    def theory(self) -> Expectation:
        """Expected values after every stage, averaged over the pixels of these frames."""
        return Expectation(self.stages, self.detected, self.first, len(self.digital))

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """Notes on possible problems of light, camera and frames, as in frame.json, command line and notebook.

        A note about a result that is probably unwanted was also a :class:`SensorWarning`.
        """
        light_notes: tuple[str, ...] = ()
        if self.light.source is not None:
            light_notes = self.light.source.notes
        _, render_notes = self.render_noise
        return tuple(by_weight([*light_notes, *self.exposure_notes, *render_notes]))

    @cached_property
    def render_noise(self) -> tuple[dict[str, float | None], tuple[str, ...]]:
        """Render noise in these frames, and the notes on it; empty without a render."""
        source = self.light.source
        if source is None:
            return {}, ()
        return source.render_noise(self)

    @cached_property
    def exposure_notes(self) -> tuple[str, ...]:
        """Notes on camera and exposure, which cost almost no time."""
        return notes_of_exposure(self.camera, self.detected, self.first)

    @cached_property
    def pixel_moments(self) -> PixelMoments:
        """``clean`` and ``temporal_variance`` with the FPN maps of this serial, and the method that computed them."""
        return pixel_moments(self.stages, self.detected, self.first)

    @cached_property
    def clean(self) -> NDArray[np.float32]:
        """Expected raw frame over temporal noise in the light of the first frame, shape (H, W) [DN].

        It contains the fixed pattern of this serial number, and is not rounded.
        """
        return self.pixel_moments.mean.astype(np.float32)

    @property
    def clean_of_each(self) -> NDArray[np.float32]:
        """Expected value of every frame, shape (N, H, W) [DN]; all are equal unless each has a separate render."""
        if self.own_clean is not None:
            return self.own_clean
        return np.broadcast_to(self.clean, self.digital.shape)

    @cached_property
    def temporal_variance(self) -> NDArray[np.float32]:
        """Temporal variance of every pixel in the light of the first frame, shape (H, W) [DN²]."""
        return self.pixel_moments.temporal.astype(np.float32)

    @cached_property
    def spatial_mean(self) -> NDArray[np.float32]:
        """Mean clean frame of the first 32 serial numbers, shape (H, W) [DN], with barely any fixed pattern."""
        windows = (
            replace(self.first.window, serial=k, _maps={}, _tiles={})
            for k in range(1, SERIALS + 1)
        )
        frames = (replace(self.first, window=window, _blocks={}) for window in windows)
        cleans = [pixel_moments(self.stages, self.detected, frame).mean for frame in frames]
        return np.asarray(np.mean(cleans, axis=0, dtype=np.float64), dtype=np.float32)

    @cached_property
    def report(self) -> dict[str, Any]:
        """Expected and measured signal after every stage, ready for JSON; see report.py."""
        return report(self.camera, self.theory, self.counts)

    @cached_property
    def counts(self) -> Mapping[str, int]:
        """Numbers of clipped pixels of the first frame, by cause."""
        if self.counted is not None:
            return self.counted
        first = self.first.on(self.backend)
        exposure = PreparedExposure(self.camera, self.stages, first, 1, (), light=self.detected)
        return exposure.frames(counted=True).counted or {}  # the same frame, computed again

    @property
    def companded(self) -> NDArray[np.unsignedinteger] | None:
        """Codes companded by the camera's knees, shape (N, H, W) [DN]; None without knees."""
        companding = self.camera.companding
        return companding.compand(self.digital) if companding.knees else None

    def preview(self, number: int = 0, gain: float = 1.0) -> NDArray[np.uint8]:
        """Return one of the frames as in frame.png, 8 bit, (H, W) grey or (H, W, 3) sRGB.  gain : brightness factor."""
        return preview_of(self, number, gain)

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Write frame.tiff, frame.png and frame.json, all or none, and remove older frames. Raises InputError."""
        save_frames(self, folder)

    def save_dng(self, path: str | os.PathLike[str], number: int = 0) -> None:
        """Write one of the frames as a DNG with unchanged pixels. Raises InputError if other programs cannot read it:
        more than 16 bits, filters other than red, green and blue in 2 × 2, or fewer than 22 × 22 pixels."""
        write_dng(path, self, number)

    def exposed_for(self, exposure: Exposure, keep: tuple[str, ...] = ()) -> Frames:
        """Return the first frame exposed again to its light, with its random numbers, for another time."""
        source, first = self.light.source, self.first.on(self.backend)
        if exposure == first.exposure:
            light = self.light
        elif isinstance(source, CollectedLight) and source.light.waveforms:
            light = photons_of(source.light, self.camera, exposure)
        else:
            light = self.light.scaled(exposure.time_s / first.exposure.time_s)
        prepared = PreparedExposure(self.camera, self.stages, first, 1, keep)
        return Frames.exposed(prepared.at(exposure).of(light))

    def save_page(self, path: str | os.PathLike[str]) -> None:
        """Write an HTML page of the first frame: a slider over exposure times, and the code, expected value and σ of
        the pixel under the pointer. Raises InputError if the file cannot be written."""
        write_page(require_path("path", path, "frame.html"), frame_page(self))

    def histogram(self) -> NDArray[np.int64]:
        """Return how many pixels of all frames have each code, shape (2**bits,)."""
        bins = 2**self.camera.code_bits
        return np.bincount(self.digital.ravel(), minlength=bins)

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw the histogram of the codes that occur, in at most 256 bins, with Matplotlib; return the axes."""
        codes = self.digital
        low, high = int(codes.min()), int(codes.max())
        width_dn = -(-(high - low + 1) // PLOTTED_BINS)
        edges = np.arange(low, high + 1 + width_dn, width_dn) - 0.5
        labels = f"Codes of {self.camera.name}", "code [DN]", f"pixels per {width_dn} DN"
        drawn = labelled_axes(axes, *labels)
        drawn.stairs(np.histogram(codes, edges)[0], edges, fill=True)
        drawn.set_yscale("symlog")
        return drawn

    def _repr_html_(self) -> str:
        return frames_html(self)

    def noise_budget(self) -> NoiseBudget:
        """Return the change of mean and variance of these frames without each noise source [DN, DN²].

        Raises InputError for combined readouts; use ``frames.readouts["high"].noise_budget()``.
        """
        refuse_readouts(self.camera, "a noise budget is of one readout", "frames.readouts")
        return NoiseBudget(self.theory)


def notes_after_render(light: Irradiance, frames: Frames) -> list[str]:
    """Return the notes on rendered light and its frames, except the note that was shown before rendering."""
    told = temperature_note(frames.first.exposure.temperature_k)
    return [*light.notes, *(note for note in frames.exposure_notes if note not in told)]
