"""Digital numbers and the likelihood of a raw frame, with derivatives into a scene that Mitsuba rendered."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike

from ...camera.camera import Camera
from ...camera.camera_file import AnyCamera, camera_of
from ...core import (
    Array,
    Exposure,
    Float64Array,
    Frame,
    InputError,
    SensorWindow,
    check_types,
    first_given,
    numbers,
    require_seed,
)
from ...core.llvm import drjit
from ...core.options import complete, documents
from ...gradient.attached_pixels import AttachedPixels
from ...gradient.parameters import TIME
from ...sensor.fpn_maps import checked_maps
from ...sensor.options import ChipOptions
from ..light.statistics import near_mean
from ..variants import MitsubaObject
from .image_light import ImageLight

EXPOSURE = "exposure."


@documents(ChipOptions)
def digital(
    image: Array,
    camera: AnyCamera | None = None,
    exposure: Exposure | None = None,
    *,
    sensor: MitsubaObject,
    parameters: Mapping[str, Array] | None = None,
    expected: bool = True,
    seed: int | None = None,
    **options: Unpack[ChipOptions],
) -> Array:
    """Return the digital numbers of an image that Mitsuba rendered, with derivatives.

    ::

        image = mitsuba.render(scene, parameters, spp=64)
        codes = ms.digital(image, camera, exposure, sensor=scene.sensors()[0])
        drjit.backward(drjit.mean((codes - target) ** 2))  # fills drjit.grad of the parameters of the scene

    image : from a <film type="photosensor">, shape (H, W, bands): the light of each band after the lens [W m⁻² sr⁻¹].
    camera, exposure, seed : default: those of the film.
    sensor : sensor of the scene with the rendered film.
    parameters : fields of the camera (``"readout.sense_gain_uv_per_e"``, ``"lens.f_number"``), ``"exposure.time_s"``
        and ``"exposure.temperature_k"`` as Dr.Jit numbers. Their values replace those of camera and exposure, and they
        get derivatives like the parameters of the scene.
    expected : True for the expected code of every pixel of this sensor unit, including clips and rounding; False for
        the code of the first frame of the seed, with the derivatives of :func:`differentiable`.

    Returns a tensor of the type of the image, shape (H, W). Raises InputError.
    """
    chip = _Chip.of(image, camera, exposure, sensor, parameters, options)
    if expected:
        return chip.tensor(chip.pixels.expected())
    seed = require_seed("seed", first_given(seed, chip.light.settings.seed, 1))
    return chip.tensor(chip.pixels.sampled(seed))


@documents(ChipOptions)
def raw_log_likelihood(
    digital: ArrayLike,
    image: Array | Sequence[Array],
    camera: AnyCamera | None = None,
    exposure: Exposure | None = None,
    *,
    sensor: MitsubaObject,
    render_variance: ArrayLike | None = None,
    parameters: Mapping[str, Array] | None = None,
    **options: Unpack[ChipOptions],
) -> Array:
    """Return the logarithm of the probability of each digital number of a raw frame, given the rendered scene.

    ::

        halves = [mitsuba.render(scene, parameters, spp=32, seed=seed) for seed in (1, 2)]
        chance = ms.raw_log_likelihood(raw, halves, camera, exposure, sensor=scene.sensors()[0])
        drjit.backward(-drjit.sum(chance))

    digital : whole numbers of one frame, shape (H, W).
    image : one image, or a list of images of the same scene with different seeds, which are averaged.
    render_variance : variance of the light of each pixel over the square of the light, shape (H, W), e.g.
        ``light.relative_error**2`` of :func:`render`. Default: from the differences of several images; a single image
        is treated as noise-free.

    The other parameters are those of :func:`digital`. The probability distribution is a Poisson count limited by the
    full well, with the read noise of every pixel and render noise, rounded and clipped. One code in 10 000 may be an
    outlier, so a wrong pixel cannot outweigh all other pixels. Row and column noise is treated as independent.

    Returns a tensor of the type of the image, shape (H, W); maximise its sum. Raises InputError.
    """
    passes: list[Array] = [*image] if isinstance(image, list | tuple) else [image]
    shapes = {getattr(x, "shape", None) for x in passes}
    if len(shapes) != 1:
        raise InputError(
            f"image is a list of images of {len(shapes)} shapes; pass one or several renders of the same sensor."
        )
    mean = sum(passes[1:], passes[0]) / len(passes)
    chip = _Chip.of(mean, camera, exposure, sensor, parameters, options)
    codes = numbers("digital", digital, "the whole numbers of a raw frame (H, W)")
    highest, shape = chip.pixels.highest, chip.light.shape
    is_code = (codes == np.round(codes)) & (codes >= 0) & (codes <= highest)
    if codes.shape != shape or not is_code.all():
        raise InputError(
            f"digital has shape {codes.shape} and values from {codes.min():g} to {codes.max():g}; it must have whole "
            f"numbers from 0 to {highest} in the shape of the image, {shape}."
        )
    render_e2 = chip.render_e2(passes, render_variance)
    return chip.tensor(chip.pixels.log_likelihood(codes.astype(np.float64), render_e2))


@dataclass(frozen=True, eq=False)
class _Chip:
    """Image, light and pixels of both functions."""

    image: Array
    light: ImageLight
    pixels: AttachedPixels

    @classmethod
    def of(
        cls,
        image: Array,
        camera: AnyCamera | None,
        exposure: Exposure | None,
        sensor: MitsubaObject,
        parameters: Mapping[str, Array] | None,
        options: ChipOptions,
    ) -> _Chip:
        """Return the checked inputs. Raises InputError."""
        chosen, backend = complete(ChipOptions, options), _backend_of(image)
        light = ImageLight.of(sensor, None if camera is None else camera_of(camera))
        exposure = _exposure(exposure, light)
        check_types(light.camera, exposure)
        values, changes = _variables(parameters or {}, type(image.array))
        changed, exposure = _with_values(light.camera, exposure, values)
        light = replace(light, camera=changed)
        growth = {name: light.growth(name, exposure) for name in values}
        number = type(image.array)  # opaque: as data of the kernel, which is compiled once
        grown = {
            name: drjit().opaque(number, g) * changes[name] for name, g in growth.items() if g
        }
        light_e = light.electrons(image, exposure, grown)
        serial = require_seed("serial", first_given(chosen["serial"], light.settings.serial, 1))
        window = SensorWindow(serial, light.shape, light.origin, camera=changed.name)
        window = replace(window, given=checked_maps(chosen["maps"], window, changed))
        frame = Frame(exposure, window, gain=changed.gain or "")
        pixels = AttachedPixels.of(changed, frame, light_e, changes, tuple(grown), backend)
        return cls(image, light, pixels)

    def render_e2(self, passes: Sequence[Array], given: ArrayLike | None) -> Float64Array:
        """Return the variance of the mean photoelectrons, shape (H, W), averaged over neighbours, so a pixel that is
        bright at random keeps its weight. Raises InputError."""
        exposure, shape = self.pixels.frame.exposure, self.light.shape
        detached = (drjit().detach(self.light.electrons(x, exposure, {})) for x in passes)
        electrons = np.stack([x.numpy().reshape(shape) for x in detached]).astype(np.float64)
        if given is None:
            count = len(passes)
            variance = electrons.var(axis=0, ddof=1) / count if count > 1 else np.zeros(shape)
            return np.asarray(near_mean(near_mean(variance)))
        relative = numbers("render_variance", given, "one relative variance per pixel (H, W)")
        if relative.shape != shape or not ((relative >= 0) & np.isfinite(relative)).all():
            raise InputError(
                f"render_variance has shape {relative.shape} and values from {relative.min():g} to {relative.max():g}; "
                f"pass finite values of at least 0 in the shape of the image, {shape}."
            )
        return np.asarray(relative * near_mean(near_mean(electrons.mean(axis=0))) ** 2)

    def tensor(self, values: Array) -> Array:
        """Return a tensor, shape (H, W)."""
        return type(self.image)(values, self.light.shape)


def _backend_of(image: Array) -> str:
    """Return "llvm" or "cuda" for an image. Raises InputError for an image without derivatives."""
    module = type(image).__module__
    single = hasattr(image, "array") and type(image.array).__name__ == "Float"
    for backend in ("llvm", "cuda"):
        if single and module == f"drjit.{backend}.ad":
            return backend
    raise InputError(
        f"image is {type(image).__name__} of {module}; pass what mitsuba.render returns in variant llvm_ad_spectral "
        "or cuda_ad_spectral."
    )


def _exposure(exposure: Exposure | None, light: ImageLight) -> Exposure:
    """Return the given exposure, else the exposure of the film. Raises InputError for a metered film."""
    chosen = exposure or light.settings.exposure
    if not isinstance(chosen, Exposure):
        raise InputError(
            "the film sets no exposure in seconds; pass one, e.g. ms.Exposure(0.01)."
        )
    return chosen


def _variables(
    parameters: Mapping[str, Array], number: Array
) -> tuple[dict[str, float], dict[str, Array]]:
    """Return the values of Dr.Jit numbers, and the numbers minus their values. Raises InputError."""
    dr, values, changes = drjit(), dict[str, float](), dict[str, Array]()
    if not isinstance(parameters, Mapping):
        raise InputError(
            f"parameters is a {type(parameters).__name__}; pass a dict of field → Dr.Jit number, "
            'e.g. {"lens.f_number": mitsuba.Float(2.8)}.'
        )
    for name, given in parameters.items():
        if not isinstance(given, number) or dr.width(given) != 1:
            raise InputError(
                f"parameters[{name!r}] is {given!r:.60}; pass one Dr.Jit number, e.g. mitsuba.Float(2.8)."
            )
        values[name] = float(given.numpy()[0])
        changes[name] = given - dr.detach(given)
    return values, changes


def _with_values(
    camera: Camera, exposure: Exposure, values: Mapping[str, float]
) -> tuple[Camera, Exposure]:
    """Return camera and exposure with these values. Raises InputError."""
    of_camera = {name: x for name, x in values.items() if not name.startswith(EXPOSURE)}
    of_exposure = {
        name.removeprefix(EXPOSURE): x for name, x in values.items() if name not in of_camera
    }
    if unknown := of_exposure.keys() - {"time_s", "temperature_k"}:
        raise InputError(
            f"parameters names {EXPOSURE + min(unknown)!r}; it can be {TIME!r} or 'exposure.temperature_k'."
        )
    if of_camera:
        camera = camera.replace(**of_camera)
    return camera, replace(exposure, **of_exposure)
