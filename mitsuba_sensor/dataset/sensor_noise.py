"""The noise of a camera as a transform of images that were made elsewhere, for augmentation."""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from ..camera.camera import Camera, with_fields_of
from ..camera.camera_file import AnyCamera, camera_of
from ..camera.figures import saturation_e
from ..core import Doubt, Exposure, InputError, Photons, check_types, warn_of
from ..core.errors import shown
from ..core.llvm import backend_problem
from ..core.types import Float32Array
from ..expose import Sensor
from ..optics.spectra import srgb_curve
from ..output.demosaic import demosaic
from ..output.frames import Frames
from ..sensor.metering import electrons_of, saturated_share
from ..stages.usual_range import warn_of_temperature
from .images import Image, Values, as_array, as_came_in, as_given, scaled

Output: TypeAlias = Literal["raw", "developed"]
KEPT = 8
"""Sensors with their FPN maps that are kept, of the last chips and gains."""
MOST_SERIAL = 2**31 - 1
LARGEST_SEED = 2**63
NEARLY_SATURATED = 0.8
"""Share of the saturation below which the brightest pixel is not looked at more closely."""
MANY_SATURATED = 0.05
"""Share of the pixels of an image from which on a note says that they are saturated."""
ALONE = threading.Lock()
"""Dr.Jit compiles and runs for one thread at a time."""


@dataclass(frozen=True)
class Draw:
    """What one image was taken with.

    serial : of the chip.  gain : setting, or None.  white_e : mean electrons of a value of 1, or None.
    seed : of the temporal noise.
    """

    serial: int
    gain: str | float | None
    white_e: float | None
    seed: int


@dataclass(frozen=True, eq=False, repr=False)
class NoisyImage:
    """image : as the transform was asked for, of the kind that it was given: an array, or a tensor.

    draws : of each image of a batch, one for a single image.  frames : of each, with theory, clean frame and origin.
    notes : sentences on what may surprise, of all images together.
    """

    image: Image
    draws: tuple[Draw, ...]
    frames: tuple[Frames, ...]
    _like: Image
    _batch: bool
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """``<NoisyImage: 120 × 160 of raspberry_pi_hq, 1 draw>``."""
        size, count = " × ".join(map(str, self.image.shape)), len(self.draws)
        return f"<NoisyImage: {size} of {self.frames[0].camera.name}, {count} draw{'s' * (count != 1)}>"

    @cached_property
    def variance_dn2(self) -> Image:
        """Variance of the temporal noise of every pixel of the raw frame, (H, W) or (N, H, W) [DN²].

        What the frame would be without temporal noise is ``frames[0].clean``.
        """
        return self._stacked([one.temporal_variance for one in self.frames])

    def _stacked(self, arrays: list[NDArray[Any]]) -> Image:
        return as_given(np.stack(arrays) if self._batch else arrays[0], self._like)


class SensorNoise:
    """What a camera makes of an image: ``noisy = ms.SensorNoise("sony_imx174", white_e=(50, 2000))(image)``.

    ::

        noise = ms.SensorNoise("sony_imx174", white_e=(50, 2000), seed=1)
        noisy = noise(np.full((48, 64), 0.5)).image

    camera : a :class:`Camera`, or what :func:`load_camera` takes.
    exposure : time and temperature, for the dark current.
    gain : setting, or several, of which one is drawn for every image; without it the camera's own numbers.
    serial : of the chip, or (first, last) of those that one is drawn from for every image.
    values : of the images: ``"electrons"``, mean photoelectrons per pixel; ``"linear"``, proportional to them, where 1
        is ``white_e``; ``"srgb"``, the same behind the curve of IEC 61966-2-1, integers of 8 bits or 0 … 1.
    white_e : mean electrons of a value of 1, or (least, most), between which the logarithm is uniform.
    output : ``"raw"``, digital numbers; ``"developed"``, an image of the values that came in, demosaiced: integers of 8
        bits again, or floats that are not clipped, so that the noise of linear values stays centred; negative ones have
        the curve of sRGB mirrored.
    seed : of all that is drawn.

    ``engine`` is the compiled one where there is LLVM, and may be set to another of :func:`expose`'s: ``"numpy"`` in
    processes that are forked.

    Images are (H, W) behind the camera's own filters, or (H, W, 3) of red, green and blue for a camera with such a
    mosaic; batches have one dimension more in front. Raises InputError for options and images that do not fit.
    """

    def __init__(
        self,
        camera: AnyCamera,
        *,
        exposure: Exposure | None = None,
        gain: str | float | Sequence[str | float] | None = None,
        serial: int | tuple[int, int] = 1,
        values: Values = "linear",
        white_e: float | tuple[float, float] | None = None,
        output: Output = "raw",
        seed: int = 0,
    ) -> None:
        self.camera = camera_of(camera)
        self.exposure = Exposure(0.01) if exposure is None else exposure
        check_types(self.camera, self.exposure)
        warn_of_temperature(self.exposure.temperature_k)
        self.gains = (
            tuple(gain) if isinstance(gain, Sequence) and not isinstance(gain, str) else (gain,)
        )
        self.serials = _range("serial", serial, 1, MOST_SERIAL, int)
        self.values = _choice("values", values, get_args(Values))
        self.output = _choice("output", output, get_args(Output))
        self.white_e = None if white_e is None else _range("white_e", white_e, 1e-3, 1e9)
        self.seed = _seed("seed", seed)
        self.engine = "drjit" if backend_problem("llvm") is None else "numpy"
        if (self.white_e is None) != (self.values == "electrons"):
            needs = 'needs white_e, e.g. (50, 2000), or "electrons"'
            if self.values == "electrons":
                needs = "has no white_e"
            raise InputError(f"values is {self.values!r}, which {needs}.")
        if not self.gains:
            raise InputError(
                f"gain is {gain!r}; pass one setting or several, or leave it out for the camera's own."
            )
        for setting in self.gains:
            self.camera.at_gain(setting)
        self.light_nm = _usual_nm(self.camera)
        self._sensors: dict[tuple[Any, ...], Sensor] = {}
        self._is_warned = False

    def __repr__(self) -> str:
        return f"SensorNoise({self.camera.name!r}, values={self.values!r}, output={self.output!r}, seed={self.seed})"

    def __call__(self, image: Image, sample: int = 0) -> NoisyImage:
        """The image as the camera takes it.

        image : (H, W), (H, W, 3), or a batch of them.  sample : number of the (first) image: the same number gives the
            same chip, gain, brightness and noise, in whatever order images come, in every process.
        """
        sample, given = _seed("sample", sample), as_array(image)
        colour = self._is_colour(given)
        batch = given.ndim == (4 if colour else 3)
        draws, frames, out, saturated = [], [], [], list[str]()
        for number, one in enumerate(given if batch else given[None]):
            draw = self.draw(sample + number)
            draws.append(draw)
            photons = self._photons(one, draw, colour)
            saturated += self._saturation_note(photons, draw)
            frames.append(self._expose(photons, draw))
            raw = frames[-1].digital[0]
            if self.output == "developed":
                out.append(as_came_in(self._developed(raw, draw, colour), given))
            else:
                out.append(raw)
        if batch:
            found = np.stack(out)
        else:
            found = out[0]
        notes = tuple(dict.fromkeys(saturated))
        if not self._is_warned:  # once of each transform: a training has thousands of images
            self._is_warned = bool(notes)
            warn_of(notes)
        made = as_given(found, image), tuple(draws), tuple(frames)
        return NoisyImage(*made, image, batch, notes)

    def __getstate__(self) -> dict[str, Any]:
        """For other processes: without sensors."""
        return {**vars(self), "_sensors": {}}

    def draw(self, sample: int) -> Draw:
        """Chip, gain, brightness and seed of an image with this number."""
        chance = np.random.default_rng([self.seed, sample])
        serial = int(chance.integers(self.serials[0], self.serials[1], endpoint=True))
        gain = self.gains[int(chance.integers(len(self.gains)))]
        white_e = None
        if self.white_e is not None:
            least, most = self.white_e
            share = chance.uniform()
            if least == most:
                white_e = float(least)
            else:
                white_e = float(least * (most / least) ** share)
        return Draw(serial, gain, white_e, int(chance.integers(LARGEST_SEED)))

    def _saturation_note(self, photons: Photons, draw: Draw) -> list[str]:
        """Where many pixels are saturated: what the brightest pixel has, and what the camera holds."""
        camera = self.camera.at_gain(draw.gain)
        level_e = saturation_e(camera)
        efficiency = camera.qe([self.light_nm])[:, 0]
        if photons.mean.max() * efficiency.max() < NEARLY_SATURATED * level_e:
            return []
        electrons = electrons_of(photons, camera, self.exposure)
        share = saturated_share(electrons, camera, self.exposure)
        if share < MANY_SATURATED:
            return []
        white = "give fewer electrons"
        if draw.white_e is not None:
            white = f"a value of 1 is {draw.white_e:.4g} e- here; give a smaller white_e"
        setting = "" if draw.gain is None else f" at gain {draw.gain}"
        return [
            Doubt(
                f"{share:.0%} of the pixels of an image are saturated: {camera.name}{setting} holds {level_e:.4g} e-; "
                f"{white}"
            )
        ]

    def _expose(self, photons: Photons, draw: Draw) -> Frames:
        key = (
            threading.get_ident(),
            draw.gain,
            draw.serial,
            photons.shape,
        )  # Dr.Jit's arrays are of one thread
        asked: Any = {"seed": draw.seed, "first_frame": 0, "engine": self.engine}
        with ALONE:
            sensor = self._sensors.pop(key, None)
            if sensor is None:
                sensor = Sensor(
                    _as_large(self.camera, photons.shape).at_gain(draw.gain), serial=draw.serial
                )
                while len(self._sensors) >= KEPT:
                    del self._sensors[next(iter(self._sensors))]
            self._sensors[key] = sensor
            return sensor.frames(photons, self.exposure, asked)

    def _is_colour(self, given: NDArray[Any]) -> bool:
        """Whether the last dimension is red, green and blue."""
        colour = given.ndim == 4 or (given.ndim == 3 and given.shape[2] == 3)
        if given.ndim in (3, 4) and given.shape[-1] == 4 and given.shape[-2] > 4:
            raise InputError(
                f"image has shape {given.shape}, with transparency; pass image[..., :3]."
            )
        layers = given.ndim == 3 and given.shape[1] > given.shape[2] in (
            1,
            2,
            4,
        )  # grey or alpha behind the pixels
        if (
            given.ndim not in (2, 3, 4)
            or (given.ndim == 4 and given.shape[3] != 3)
            or layers
            or not given.size
        ):
            raise InputError(
                f"image has shape {given.shape}; pass (H, W), (H, W, 3), or a batch of one of them."
            )
        names = {name[:1].upper() for name in self.camera.filter_names}
        planes_first = given.ndim == 3 and given.shape[0] == 3 and not colour
        if planes_first and names == set("RGB"):
            raise InputError(
                f"image has shape {given.shape}: one colour image whose planes come first, or three grey ones? "
                "Pass the first as np.moveaxis(image, 0, -1), and three grey ones one by one."
            )
        if colour and names != set("RGB"):
            filters = ", ".join(self.camera.filter_names) or "none"
            raise InputError(
                f"image has shape {given.shape} and {self.camera.name} the filters {filters}; pass (H, W), the light "
                "behind each pixel's own filter."
            )
        return colour

    def _photons(self, given: NDArray[Any], draw: Draw, colour: bool) -> Photons:
        """Mean photons per pixel at one wavelength that give the image's photoelectrons behind each filter."""
        efficiency, tile = self.camera.qe([self.light_nm])[:, 0], self.camera.tile
        mean = np.empty(given.shape[:2], np.float32)
        for row, numbers in enumerate(tile):
            for column, number in enumerate(numbers):
                part = slice(row, None, len(tile)), slice(column, None, len(numbers))
                letter = self.camera.filter_names[number][:1].upper()
                if colour:
                    values = given[part][..., "RGB".index(letter)]
                else:
                    values = given[part]
                with np.errstate(over="ignore", invalid="ignore"):
                    mean[part] = scaled(
                        values,
                        self.values,
                        np.float32((draw.white_e or 1.0) / efficiency[number]),
                    )
        if not 0 <= mean.min() <= mean.max() < np.inf:
            worst = given[~((given >= 0) & np.isfinite(given))]
            if worst.size:
                value = worst.flat[0]
            else:
                value = given.max()
            raise InputError(
                f"image has values such as {value:g}; mean light is finite and at least 0, in float32."
            )
        return Photons(mean[..., None], np.array([self.light_nm]))

    def _developed(self, raw: NDArray[Any], draw: Draw, colour: bool) -> Float32Array:
        """In the values that came in: black level and gain are taken out, missing colours interpolated."""
        camera = self.camera.at_gain(draw.gain)
        scale = camera.system_gain_dn_per_e * (draw.white_e or 1.0)
        linear = (raw.astype(np.float64) - camera.black_level_dn) / scale
        if colour:
            names = [name[:1].upper() for name in camera.filter_names]
            filters = camera.filter_index(linear.shape)
            if np.unique(filters).size < len(names):
                size = f"{linear.shape[0]} × {linear.shape[1]}"
                raise InputError(
                    f'image has {size} pixels, which lack a colour; pass more of them, or output="raw".'
                )
            linear = demosaic(linear, filters, camera)[..., [names.index(c) for c in "RGB"]]
        if self.values == "srgb":
            linear = np.copysign(srgb_curve(np.abs(linear)), linear)
        return linear.astype(np.float32)


def _usual_nm(camera: Camera) -> float:
    """Where every filter sees light, best for the one that sees least, and a photon makes one electron."""
    section = camera.quantum_efficiency
    low, high = camera.band_nm
    at = np.arange(math.ceil(low), math.floor(high) + 1.0)
    least = camera.qe(at).min(axis=0)
    if section.quantum_yield:
        points = section.wavelengths_nm or [low, high]
        least = np.where(np.interp(at, points, section.quantum_yield) == 1, least, 0.0)
    if not least.max() > 0:
        raise InputError(
            f"{camera.name} has filters that share no wavelength; the noise of images needs one."
        )
    return float(at[int(np.argmax(least))])


def _as_large(camera: Camera, shape: tuple[int, ...]) -> Camera:
    """With rows and columns enough for the image."""
    rows, columns = (camera.sensor.rows or 0, camera.sensor.columns or 0)
    if shape[0] <= rows and shape[1] <= columns:
        return camera
    size = {"sensor.rows": max(rows, shape[0]), "sensor.columns": max(columns, shape[1])}
    return with_fields_of(camera, size, "as large as the image")


def _choice(name: str, value: Any, known: tuple[str, ...]) -> Any:
    if not isinstance(value, str) or value not in known:
        raise InputError(f"{name} is {shown(value)}; it must be one of {', '.join(known)}.")
    return value


def _seed(name: str, value: Any) -> int:
    if (
        isinstance(value, bool)
        or not isinstance(value, int | np.integer)
        or not 0 <= value < LARGEST_SEED
    ):
        raise InputError(f"{name} is {value!r}; it must be a whole number from 0 to 2⁶³ − 1.")
    return int(value)


def _range(
    name: str, value: Any, least: float, most: float, kind: type = float
) -> tuple[Any, Any]:
    """(low, high) of one number or two, whole ones for the kind int."""
    if isinstance(value, Sequence) and not isinstance(value, str):
        ends = tuple(value)
    else:
        ends = (value, value)
    known = (int, np.integer) if kind is int else (int, float, np.integer, np.floating)
    numbers = all(isinstance(one, known) and not isinstance(one, bool) for one in ends)
    if len(ends) != 2 or not numbers or not least <= ends[0] <= ends[1] <= most:
        what = "number"
        if kind is int:
            what = "whole number"
        raise InputError(
            f"{name} is {value!r}; it must be a {what} from {least:g} to {most:g}, or two: (low, high)."
        )
    return ends
