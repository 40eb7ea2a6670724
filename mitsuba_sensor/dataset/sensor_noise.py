"""Adds the noise of a camera to images of other programs, for augmentation."""

# Without `from __future__ import annotations`: core/options.py reads the declarations of options at run time.
import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Literal, TypeAlias, TypedDict, Unpack

import numpy as np

from ..camera.camera import Camera, with_fields_of
from ..camera.camera_file import AnyCamera, camera_of
from ..camera.figures import saturation_e
from ..core import Doubt, Exposure, InputError, Photons, check_types, refuse_masked, warn_of
from ..core.checks import PICTURE_FILE, refuse_path
from ..core.errors import require, require_seed, shown
from ..core.llvm import backend_problem
from ..core.options import Option, complete, documents
from ..core.types import Float32Array, NumpyArray
from ..expose import Sensor
from ..optics.spectra import inverse_srgb_curve, srgb_curve
from ..output.demosaic import demosaic
from ..output.frames import Frames
from ..sensor.metering import saturated_share
from ..stages.usual_range import warn_of_temperature

Image: TypeAlias = Any
"""A NumPy array, or a tensor of PyTorch (only its methods are used)."""
SENSORS_MAX = 8
"""Sensors that are kept with their FPN maps, for the latest sensor units and gains."""
SERIAL_MAX = 2**31 - 1
SEED_END = 2**63
"""End of the random seeds of temporal noise."""
SRGB_MAX = 1.001
"""Values after the sRGB curve are at most 1, except for rounding in half precision."""
SATURATED_FRACTION_MIN = 0.05
"""Fraction of saturated pixels from which a note reports saturation."""
ONE_THREAD = threading.Lock()
"""Dr.Jit compiles and runs for one thread at a time."""


def _range(low: float, high: float, is_seed: bool = False) -> Callable[[str, Any], Any]:
    """Return a check of one number or two, which returns (lowest, highest)."""

    def checked(name: str, value: Any) -> tuple[Any, Any]:
        ends = tuple(value) if isinstance(value, list | tuple) else (value, value)
        for end in ends:
            require(name, end, low, high, "or two: (lowest, highest)")
            if is_seed:
                require_seed(name, end)
        if len(ends) != 2 or ends[0] > ends[1]:
            raise InputError(
                f"{name} is {shown(value)}; it must be one number, or (lowest, highest)."
            )
        return ends

    return checked


class NoiseOptions(TypedDict, total=False):
    """All options of :class:`SensorNoise`."""

    gain: Annotated[
        str | float | Sequence[str | float] | None,
        Option(
            "Gain setting, or several, of which each image draws one. Default: the camera's own parameters."
        ),
    ]
    serial: Annotated[
        int | tuple[int, int],
        Option(
            "Serial number of the sensor unit, or (first, last), between which each image draws one.",
            1,
            check=_range(1, SERIAL_MAX, is_seed=True),
        ),
    ]
    values: Annotated[
        Literal["electrons", "linear", "srgb"],
        Option(
            "Unit of image values. electrons: mean photoelectrons per pixel. linear: proportional to electrons, 1 is "
            "white_e. srgb: linear values after the curve of IEC 61966-2-1, as 8-bit integers or from 0 to 1.",
            "linear",
        ),
    ]
    white_e: Annotated[
        float | tuple[float, float] | None,
        Option(
            "Mean electrons of a value of 1, or (least, most), between which their logarithm is uniform.",
            check=_range(1e-3, 1e9),
        ),
    ]
    output: Annotated[
        Literal["raw", "developed"],
        Option(
            "raw: digital numbers. developed: a demosaiced image in the unit of the input, as 8-bit integers or "
            "unclipped floats, so noise around black stays centred (negative values mirror the sRGB curve).",
            "raw",
        ),
    ]
    seed: Annotated[int, Option("Seed of all random choices.", 0, check=require_seed)]


@dataclass(frozen=True)
class Draw:
    """Random choices for one image.

    serial : of the sensor unit.  gain : setting, or None.  white_e : mean electrons of a value of 1, or None.
    seed : of the temporal noise.
    """

    serial: int
    gain: str | float | None
    white_e: float | None
    seed: int


@dataclass(frozen=True, eq=False, repr=False)
class NoisyImage:
    """image : raw or developed, an array or a tensor like the input.

    draws, frames : one for each image of a batch; frames have theory, clean frame and origin.
    notes : sentences on possible problems of all images.
    """

    image: Image
    draws: tuple[Draw, ...]
    frames: tuple[Frames, ...]
    _is_batch: bool
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """``<NoisyImage: 120 × 160 of raspberry_pi_hq, 1 draw>``."""
        size, count = " × ".join(map(str, self.image.shape)), len(self.draws)
        return f"<NoisyImage: {size} of {self.frames[0].camera.name}, {count} draw{'s' * (count != 1)}>"

    @cached_property
    def variance_dn2(self) -> Image:
        """Temporal variance of every pixel of the raw frame, shape (H, W) or (N, H, W) [DN²].

        The frame without temporal noise is ``frames[0].clean``.
        """
        variances = np.stack([frames.temporal_variance for frames in self.frames])
        return _like(self.image, variances if self._is_batch else variances[0])


class SensorNoise:
    """The noise of a camera, added to images: ``noisy = ms.SensorNoise("sony_imx174", white_e=(50, 2000))(image)``.

    ::

        noise = ms.SensorNoise("sony_imx174", white_e=(50, 2000), seed=1)
        noisy = noise(np.full((48, 64), 0.5)).image

    camera : a :class:`Camera`, or an argument of :func:`load_camera`.
    exposure : time and temperature, for the dark current.

    ``engine`` is the compiled engine if there is LLVM. Forked processes need ``"numpy"``.

    Images are (H, W) after the camera's own filters, or (H, W, 3) in red, green and blue for a camera with such a
    mosaic; batches have one dimension more in front. Raises InputError for options and images that do not fit.
    """

    @documents(NoiseOptions)
    def __init__(
        self,
        camera: AnyCamera,
        *,
        exposure: Exposure | None = None,
        **options: Unpack[NoiseOptions],
    ) -> None:
        self.camera = camera_of(camera)
        self.exposure = Exposure(0.01) if exposure is None else exposure
        check_types(self.camera, self.exposure)
        warn_of_temperature(self.exposure.temperature_k)
        chosen = complete(NoiseOptions, options)
        gain, self.values, self.output = chosen["gain"], chosen["values"], chosen["output"]
        serials: Any = chosen["serial"]
        white: Any = chosen["white_e"]
        self.serials, self.white_e, self.seed = serials, white, chosen["seed"]
        self.gains = tuple(gain) if isinstance(gain, list | tuple) else (gain,)
        self.engine = "drjit" if backend_problem("llvm") is None else "numpy"
        if (self.white_e is None) != (self.values == "electrons"):
            if self.white_e is None:
                raise InputError(
                    "white_e is missing: give the photoelectrons at white, e.g. 2000, or (50, 2000) to draw it; only "
                    "values='electrons' needs none."
                )
            raise InputError(
                f"white_e is {shown(options.get('white_e'))} and values='electrons' needs none; omit one of them."
            )
        if not self.gains:
            raise InputError(f"gain is {gain!r}; pass one setting or several, or omit it.")
        for setting in self.gains:
            self.camera.at_gain(setting)
        self.light_nm = _wavelength_nm(self.camera)
        self._efficiency = self.camera.qe([self.light_nm])[:, 0]
        self._letters = [name[:1].upper() for name in self.camera.filter_names]
        self._sensors: dict[tuple[Any, ...], Sensor] = {}
        self._is_warned = False

    def __repr__(self) -> str:
        return f"SensorNoise({self.camera.name!r}, values={self.values!r}, output={self.output!r}, seed={self.seed})"

    def __call__(self, image: Image, sample: int = 0) -> NoisyImage:
        """Return the image with the camera's noise.

        image : (H, W), (H, W, 3), or a batch of them.  sample : number of the (first) image. The same number gives the
            same sensor unit, gain, brightness and noise, in any order and in every process.
        """
        sample, given = require_seed("sample", sample), _array_of(image)
        is_colour = self._is_colour(given)
        is_batch = given.ndim == 3 + is_colour
        images = given if is_batch else given[None]
        draws = tuple(self.draw(sample + number) for number in range(len(images)))
        photons = [*map(self._photons, images, draws)]
        frames = tuple(map(self._expose, photons, draws))
        made: list[NumpyArray] = [x.digital[0] for x in frames]
        if self.output == "developed":
            made = [
                self._developed(x, draw, given.dtype, is_colour)
                for x, draw in zip(made, draws, strict=True)
            ]
        notes = tuple(dict.fromkeys(filter(None, map(self._saturation_note, photons, draws))))
        if not self._is_warned:  # once per transform: a training has thousands of images
            self._is_warned = bool(notes)
            warn_of(notes)
        noisy = _like(image, np.stack(made) if is_batch else made[0])
        return NoisyImage(noisy, draws, frames, is_batch, notes)

    def __getstate__(self) -> dict[str, Any]:
        """Pickle without sensors."""
        return {**vars(self), "_sensors": {}}

    def draw(self, sample: int) -> Draw:
        """Return sensor unit, gain, brightness and seed of the image with this number."""
        random = np.random.default_rng([self.seed, sample])
        serial = int(random.integers(self.serials[0], self.serials[1], endpoint=True))
        gain = self.gains[int(random.integers(len(self.gains)))]
        white_e = None
        if self.white_e is not None:
            (least, most), share = self.white_e, random.uniform()
            white_e = float(least if least == most else least * (most / least) ** share)
        return Draw(serial, gain, white_e, int(random.integers(SEED_END)))

    def _saturation_note(self, photons: Photons, draw: Draw) -> str:
        """Return a note on saturated pixels with a remedy; an empty text if there are few."""
        camera = self.camera.at_gain(draw.gain)
        rows, columns, _ = photons.shape
        efficiency = self._efficiency[camera.filter_index((rows, columns))]
        share = saturated_share(photons.mean[..., 0] * efficiency, camera, self.exposure)
        if share < SATURATED_FRACTION_MIN:
            return ""
        remedy = "give fewer electrons"
        if draw.white_e is not None:
            remedy = f"a value of 1 is {draw.white_e:.4g} e- here; give a smaller white_e"
        setting = "" if draw.gain is None else f" at gain {draw.gain}"
        return Doubt(
            f"{100 * share:.0f} % of the pixels of an image are saturated: {camera.name}{setting} holds "
            f"{saturation_e(camera):.4g} e-; {remedy}"
        )

    def _expose(self, photons: Photons, draw: Draw) -> Frames:
        # arrays of Dr.Jit belong to one thread
        key = (threading.get_ident(), draw.gain, draw.serial, photons.shape)
        asked: Any = {"seed": draw.seed, "first_frame": 0, "engine": self.engine}
        with ONE_THREAD:
            sensor = self._sensors.pop(key, None)
            if sensor is None:
                camera = _at_least_as_large(self.camera, photons.shape).at_gain(draw.gain)
                sensor = Sensor(camera, serial=draw.serial)
                while len(self._sensors) >= SENSORS_MAX:
                    del self._sensors[next(iter(self._sensors))]
            self._sensors[key] = sensor
            return sensor.frames(photons, self.exposure, asked)

    def _is_colour(self, given: NumpyArray) -> bool:
        """Return True if the last dimension is red, green and blue. Raises InputError for other shapes."""
        shape, is_rgb = given.shape, set(self._letters) == set("RGB")
        is_colour = given.ndim == 4 or (given.ndim == 3 and shape[2] == 3)
        is_grey_or_alpha = given.ndim == 3 and shape[1] > shape[2] and shape[2] in (1, 2, 4)
        is_planes = given.ndim == 3 and shape[0] == 3 and not is_colour and is_rgb
        is_image = given.ndim in (2, 3, 4) and given.size and not is_grey_or_alpha
        if not is_image or is_planes or (given.ndim == 4 and shape[3] != 3):
            raise InputError(
                f"image has shape {shape}; pass (H, W), (H, W, 3), or a batch of them: image[..., :3] without "
                "transparency, np.moveaxis(image, 0, -1) for three planes, three grey images individually."
            )
        if is_colour and not is_rgb:
            filters = ", ".join(self.camera.filter_names) or "none"
            raise InputError(
                f"image has shape {shape}, but {self.camera.name} has the filters {filters}; pass (H, W), the light "
                "after each pixel's own filter."
            )
        return is_colour

    def _photons(self, image: NumpyArray, draw: Draw) -> Photons:
        """Return the mean photons per pixel at one wavelength that give the photoelectrons of the image."""
        filters = self.camera.filter_index(image.shape[:2])
        values = image
        if image.ndim == 3:
            channels = np.array(["RGB".index(letter) for letter in self._letters])[filters]
            values = np.take_along_axis(image, channels[..., None], 2)[..., 0]
        factors = ((draw.white_e or 1.0) / self._efficiency).astype(np.float32)[filters]
        with np.errstate(over="ignore", invalid="ignore"):
            mean = self._linear(values) * factors
        if not 0 <= mean.min() <= mean.max() < np.inf:
            wrong = image[~((image >= 0) & np.isfinite(image))]
            value = wrong.flat[0] if wrong.size else image.max()
            raise InputError(
                f"image has values such as {value:g}; mean light must be finite and at least 0, in float32."
            )
        return Photons(mean[..., None], np.array([self.light_nm]))

    def _linear(self, values: NumpyArray) -> Float32Array:
        """Return values proportional to light, as float32. Raises InputError for other values."""
        is_whole = values.dtype.kind in "iu"
        if self.values == "linear" and is_whole:
            raise InputError(
                f"image is {values.dtype}, as in a picture, but values is 'linear', where 1 is white; pass "
                'values="srgb" for a picture, or floats with white at 1.'
            )
        if self.values != "srgb":
            return np.asarray(values, np.float32)
        if values.dtype == np.uint8:
            levels = inverse_srgb_curve(np.linspace(0, 1, 256, dtype=np.float32))
            return np.asarray(np.take(levels, values), np.float32)
        if is_whole or not 0 <= values.min() <= values.max() <= SRGB_MAX:
            raise InputError(
                f"image is {values.dtype} with values from {values.min():g} to {values.max():g}, but values 'srgb' "
                "takes uint8, or floats from 0 to 1; divide by the code of white, clip with np.clip(image, 0, 1), or "
                'pass values="linear" for light above white.'
            )
        return np.asarray(inverse_srgb_curve(values.astype(np.float32)), np.float32)

    def _developed(
        self, raw: NumpyArray, draw: Draw, kind: np.dtype[Any], is_colour: bool
    ) -> NumpyArray:
        """Return the image in the unit of the input: without black level and gain, missing colours interpolated."""
        camera = self.camera.at_gain(draw.gain)
        scale = camera.system_gain_dn_per_e * (draw.white_e or 1.0)
        linear = (raw.astype(np.float64) - camera.black_level_dn) / scale
        if is_colour:
            filters = camera.filter_index(linear.shape)
            if np.unique(filters).size < len(self._letters):
                raise InputError(
                    f"image has {linear.shape[0]} × {linear.shape[1]} pixels, which lack a colour; pass more pixels, "
                    'or output="raw".'
                )
            order = [self._letters.index(letter) for letter in "RGB"]
            linear = demosaic(linear, filters, camera)[..., order]
        if self.values == "srgb":
            linear = np.copysign(srgb_curve(np.abs(linear)), linear)
        developed = linear.astype(np.float32)
        if kind != np.uint8:
            return developed
        return np.clip(np.rint(developed * 255), 0, 255).astype(np.uint8)


def _array_of(image: Image) -> NumpyArray:
    """Return the array of an image or a tensor. Raises InputError for booleans, text and complex numbers."""
    if hasattr(image, "detach"):
        image = image.detach().cpu()
        # NumPy has no bfloat16
        image = (image.float() if image.is_floating_point() else image).numpy()
    refuse_masked("image", image)
    refuse_path("image", image, PICTURE_FILE)
    array = np.asarray(image)
    if array.dtype.kind not in "iuf":
        raise InputError(f"image is {array.dtype}; pass integers or floats.")
    return array


def _like(given: Image, values: NumpyArray) -> Image:
    """Return a tensor of floats for a tensor (its integers may be too short), else the array."""
    if hasattr(given, "new_tensor"):
        return given.new_empty(0).float().new_tensor(values.astype(np.float32))
    return values


def _wavelength_nm(camera: Camera) -> float:
    """Return the wavelength at which the least sensitive filter is best, and a photon makes one electron."""
    section = camera.quantum_efficiency
    low, high = camera.band_nm
    at = np.arange(math.ceil(low), math.floor(high) + 1.0)
    least = camera.qe(at).min(axis=0)
    if section.quantum_yield:
        points = section.wavelengths_nm or [low, high]
        least = np.where(np.interp(at, points, section.quantum_yield) == 1, least, 0.0)
    if not least.max() > 0:
        raise InputError(
            f"{camera.name} has filters without a common wavelength; the noise of images needs one."
        )
    return float(at[int(np.argmax(least))])


def _at_least_as_large(camera: Camera, shape: tuple[int, ...]) -> Camera:
    """Return the camera with enough rows and columns for an image."""
    sensor = camera.sensor
    sizes = {"sensor.rows": sensor.rows or 0, "sensor.columns": sensor.columns or 0}
    pairs = zip(sizes.items(), shape, strict=False)
    larger = {name: pixels for (name, before), pixels in pairs if pixels > before}
    return with_fields_of(camera, larger, "as large as the image")
