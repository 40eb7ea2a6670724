"""Digital numbers and the likelihood of a raw frame, with the graph of derivatives of a scene that Mitsuba rendered."""

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
    """Digital numbers of an image that Mitsuba rendered, with derivatives.

    ::

        image = mitsuba.render(scene, parameters, spp=64)
        codes = ms.digital(image, camera, exposure, sensor=scene.sensors()[0])
        drjit.backward(drjit.mean((codes - target) ** 2))  # fills drjit.grad of the parameters of the scene

    image : of a <film type="photosensor">, (H, W, bands): the light of each band behind the lens [W m⁻² sr⁻¹].
    camera, exposure, seed : by default those of the film.
    sensor : of the scene, whose film has been rendered.
    parameters : fields of the camera (``"readout.sense_gain_uv_per_e"``, ``"lens.f_number"``), ``"exposure.time_s"``
        and ``"exposure.temperature_k"`` as Dr.Jit numbers, whose values replace those of camera and exposure, and which
        get derivatives as the parameters of the scene do.
    expected : the expected code of every pixel of this chip, clips and rounding included; or, if False, the code of
        the first frame of the seed, with the derivatives of :func:`differentiable`.
    Returns a tensor (H, W) of the type of the image. Raises InputError.
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

    digital : (H, W) whole numbers of one frame.
    image : one image, or a list of images of the same scene with different seeds, whose mean is taken.
    render_variance : (H, W) variance of the light of each pixel over the square of the light, e.g.
        ``light.relative_error**2`` of :func:`render`. Default: from the differences of several images; one image
        counts as free of noise.
    The rest as for :func:`digital`.
    The distribution is that of a Poisson count behind a full well, with the read noise of every pixel and the noise of
    the render, rounded and clipped. One code in 10 000 may be an outlier, so a wrong pixel cannot outweigh all others.
    Temporal noise that pixels of a row or column share is treated as independent.
    Returns a tensor (H, W) of the type of the image; its sum is what to maximise. Raises InputError.
    """
    passes: list[Array] = [*image] if isinstance(image, list | tuple) else [image]
    shapes = {getattr(one, "shape", None) for one in passes}
    if len(shapes) != 1:
        raise InputError(
            f"image is a list of images of {len(shapes)} shapes; pass one or several renders of the same sensor."
        )
    mean = passes[0]
    for one in passes[1:]:
        mean = mean + one
    mean = mean / len(passes)
    chip = _Chip.of(mean, camera, exposure, sensor, parameters, options)
    highest, codes = (
        chip.pixels.highest,
        numbers("digital", digital, "the whole numbers of a raw frame (H, W)"),
    )
    shape = chip.light.shape
    if (
        codes.shape != shape
        or not ((codes == np.round(codes)) & (codes >= 0) & (codes <= highest)).all()
    ):
        raise InputError(
            f"digital has shape {codes.shape} and values from {codes.min():g} to {codes.max():g}; it must have whole "
            f"numbers from 0 to {highest} in the shape of the image, {shape}."
        )
    render_e2 = chip.render_e2(passes, render_variance)
    return chip.tensor(chip.pixels.log_likelihood(codes.astype(np.float64), render_e2))


@dataclass(frozen=True, eq=False)
class _Chip:
    """What both functions need."""

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
        """Checked."""
        chosen = complete(ChipOptions, options)
        maps = chosen["maps"]
        backend = _backend_of(image)
        given = None if camera is None else camera_of(camera)
        light = ImageLight.of(sensor, given)
        exposure = _exposure(exposure, light)
        check_types(light.camera, exposure)
        values, changes = _variables(parameters or {}, type(image.array))
        own, exposure = _with_values(light.camera, exposure, values)
        light = replace(light, camera=own)
        growth = {name: light.growth(name, exposure) for name in values}
        number = type(image.array)  # opaque: as data of the kernel, which is compiled once
        grown = {
            name: drjit().opaque(number, g) * changes[name] for name, g in growth.items() if g
        }
        light_e = light.electrons(image, exposure, grown)
        serial = require_seed("serial", first_given(chosen["serial"], light.settings.serial, 1))
        window = SensorWindow(serial, light.shape, light.origin, camera=own.name)
        window = replace(window, given=checked_maps(maps, window, own))
        frame = Frame(exposure, window, gain=own.gain or "")
        pixels = AttachedPixels.of(own, frame, light_e, changes, tuple(grown), backend)
        return cls(image, light, pixels)

    def render_e2(self, passes: Sequence[Array], given: ArrayLike | None) -> Float64Array:
        """Return the variance of the mean photoelectrons, (H, W), averaged over neighbours: a pixel that is bright by
        chance must not weigh less for it. Raises InputError."""
        exposure, shape = self.pixels.frame.exposure, self.light.shape
        electrons = np.stack(
            [
                drjit().detach(self.light.electrons(one, exposure, {})).numpy().reshape(shape)
                for one in passes
            ]
        ).astype(np.float64)
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
        """As (H, W)."""
        return type(self.image)(values, self.light.shape)


def _backend_of(image: Array) -> str:
    """ "llvm" or "cuda" of an image. Raises InputError for one without derivatives."""
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
    """The one given, else that of the film. Raises InputError where that is metered."""
    if exposure is not None:
        return exposure
    found = light.settings.exposure
    if not isinstance(found, Exposure):
        raise InputError(
            "the film sets no exposure in seconds; pass one, e.g. ms.Exposure(0.01)."
        )
    return found


def _variables(
    parameters: Mapping[str, Array], number: Array
) -> tuple[dict[str, float], dict[str, Array]]:
    """Values of Dr.Jit numbers, and the numbers minus their values. Raises InputError."""
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
    """Camera and exposure with these values. Raises InputError."""
    of_exposure, of_camera = dict[str, float](), dict[str, float]()
    for name, value in values.items():
        if name.startswith(EXPOSURE):
            of_exposure[name.removeprefix(EXPOSURE)] = value
        else:
            of_camera[name] = value
    if unknown := of_exposure.keys() - {"time_s", "temperature_k"}:
        raise InputError(
            f"parameters names {EXPOSURE + min(unknown)!r}; there are {TIME!r} and 'exposure.temperature_k'."
        )
    return camera.replace(**of_camera) if of_camera else camera, replace(
        exposure, **of_exposure
    )
