"""The photoelectrons of an image that plain Mitsuba rendered with a photosensor, which is ∫L dλ of bands after the
lens.

    λ = Ω(x, y)·Σ_b w_fb·L_b

with L_b the values of the image [W m⁻² sr⁻¹], Ω the projected solid angle of the lens [sr] (optics/f_number_law.py),
and w_fb the electrons of 1 W m⁻² of band b behind filter f: transmission of the lens, area and QE of the pixel, time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ...camera.camera import Camera
from ...camera.fingerprint import response_fingerprint
from ...core import Array, Exposure, Float64Array, InputError, check_types
from ...core.llvm import drjit
from ...gradient.parameters import Parameters
from ...optics.f_number_law import solid_angle_sr, transmittance
from ...optics.intrinsics import View
from ..light.bands import BANDWIDTH_NM, Bands, choose_bands
from ..light.photons import electrons_per_irradiance
from ..load.scene import view_of_sensor
from ..scene.plugin_parameters import parameters_of
from ..scene.scene_settings import SceneSettings, settings_from
from ..variants import MitsubaObject, mitsuba

ANOTHER = (
    'load a scene with a <film type="photosensor"> and pass its sensor, e.g. scene.sensors()[0]'
)
FOCUS_STEP = 1e-4  # relative step of the difference by a focus distance
SAME_DERIVATIVE = 1e-6  # relative difference of equal derivatives of different bands or places


@dataclass(frozen=True, eq=False)
class ImageLight:
    """Conversion of the image of one sensor to photoelectrons.

    settings : of the film and the sensor around it.  camera : camera with the pixels and the lens.
    focus : distance of a thin lens in scene units, a variable of Mitsuba; None for a pinhole.
    unit_m : metres per scene unit.
    """

    settings: SceneSettings
    camera: Camera
    bands: Bands
    view: View
    focus: Array
    unit_m: float

    @classmethod
    def of(cls, sensor: MitsubaObject, camera: Camera | None) -> ImageLight:
        """Return the conversion for a Mitsuba sensor with a photosensor as its film. Raises InputError for any other
        sensor."""
        if camera is not None:
            check_types(camera, Exposure(0.0))
        film = getattr(sensor, "film", None)
        known = None if film is None else parameters_of(film())
        if known is None or known.film.get("output", "bands") != "bands":
            raise InputError(
                f"sensor is {type(sensor).__name__}, and no sensor of Mitsuba with a photosensor of output bands as "
                f"its film; {ANOTHER}."
            )
        settings = settings_from(known.film, {})
        of_film = settings.camera
        assert of_film is not None  # a photosensor requires a camera
        width_nm, spectral = settings.bandwidth_nm or BANDWIDTH_NM, settings.spectral or "auto"
        bands = choose_bands(of_film, settings.wavelength_nm, width_nm, spectral)
        chosen = camera or of_film
        if bands.response is not None and bands.response != response_fingerprint(chosen):
            raise InputError(
                "the film has the channels of a camera with another quantum efficiency or lens; set its camera, or its "
                'spectral to "cube", which serves any camera.'
            )
        if chosen.quantum_efficiency.quantum_yield is not None:
            raise InputError(
                f"{chosen.name} has a quantum_yield, for which digital has no derivative; take ms.differentiable."
            )
        if chosen.sensor.polarizers is not None:
            raise InputError(
                f"{chosen.name} has polarisers, which images of Mitsuba's own sensors ignore; take ms.render, or a "
                "camera without sensor.polarizers."
            )
        unit_m = settings_from(known.film, known.sensor or {}).unit_m or 1.0
        focus = mitsuba().traverse(sensor).get("focus_distance")
        return cls(settings, chosen, bands, view_of_sensor(sensor, unit_m), focus, unit_m)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the image."""
        return self.view.crop_size[::-1]

    @property
    def origin(self) -> tuple[int, int]:
        """Row and column of the first pixel on the sensor."""
        return self.view.crop_offset[::-1]

    def electrons(self, image: Array, exposure: Exposure, growth: Mapping[str, Array]) -> Array:
        """Return the mean photoelectrons of every pixel, shape (H·W,), on Dr.Jit with derivatives.

        growth : by parameter name, relative derivative of the electrons times the change of the parameter.
        """
        self._check(image)
        dr, values = drjit(), image.array
        number, unsigned = type(values), dr.uint32_array_t(type(values))
        channels, pixels = image.shape[2], image.shape[0] * image.shape[1]
        pixel = dr.arange(unsigned, pixels * channels) // channels
        place = self._filter_of(pixel, unsigned) * channels
        band = dr.arange(unsigned, pixels * channels) - pixel * channels
        weights = number(self._weights(self.camera, exposure).astype(np.float32).ravel())
        light = dr.block_sum(values * dr.gather(number, weights, place + band), channels)
        omega = self._solid_angle(self.camera, self.view).astype(np.float32).ravel()
        more = sum(growth.values(), number(1.0))
        return light * number(omega) * (more + self._growth_by_focus())

    def _growth_by_focus(self) -> Array:
        """Return the relative change of Ω with the focus distance by the magnification, whose value is 0, if the
        distance has derivatives."""
        dr = drjit()
        if self.focus is None or not dr.grad_enabled(self.focus):
            return 0.0
        step_m = FOCUS_STEP * self.view.focus_m
        far, near = (
            self._solid_angle(self.camera, replace(self.view, focus_m=self.view.focus_m + step))
            for step in (step_m, -step_m)
        )
        per_m = float(np.log(far / near).mean()) / (2 * step_m)
        growth = dr.opaque(type(self.focus), per_m * self.unit_m)
        return growth * (self.focus - dr.detach(self.focus))

    def growth(self, name: str, exposure: Exposure) -> float:
        """Return d ln(electrons)/d ``name`` at the same image; 0 for a parameter without influence."""
        numbers = Parameters(self.camera, exposure)

        def of_lens(camera: Camera, exposure: Exposure) -> Float64Array:
            return self._solid_angle(camera, self.view)

        value, total = numbers.value(name), 0.0
        for function in (self._weights, of_lens):
            values = function(self.camera, exposure)
            lit = values > 0
            relative = numbers.derivative(name, function, (name,))[lit] / values[lit]
            if not relative.size or np.abs(relative).max() * abs(value) < SAME_DERIVATIVE:
                continue
            if np.ptp(relative) > SAME_DERIVATIVE * np.abs(relative).max():
                raise InputError(
                    f"parameters names {name!r}, which changes the light of different bands or places differently; "
                    "compare two values instead."
                )
            total += float(relative.mean())
        return total

    def _weights(self, camera: Camera, exposure: Exposure) -> Float64Array:
        """Return the electrons for 1 W m⁻² in each channel of the film and each colour filter, shape (F, B)."""
        scale = self.bands.scale
        if self.bands.kind != "channels" and camera.lens.transmission_curve is None:
            passed = transmittance(camera, self.bands.wavelengths_nm)
            scale = passed / self.bands.bandwidths_nm
        return electrons_per_irradiance(camera, exposure, self.bands) * scale

    def _solid_angle(self, camera: Camera, view: View) -> Float64Array:
        """Return Ω [sr] of every pixel; plain Mitsuba's rays have no distortion."""
        straight = camera.lens.model_copy(update={"distortion": None})
        return solid_angle_sr(view, camera.model_copy(update={"lens": straight}))

    def _filter_of(self, pixel: Array, unsigned: type) -> Array:
        """Return the index of the colour filter of these pixels."""
        tile, (row, column) = np.array(self.camera.quantum_efficiency.filter_tile), self.origin
        high, wide = tile.shape
        dr, columns = drjit(), self.shape[1]
        y = (pixel // columns + row % high) % high
        x = (pixel % columns + column % wide) % wide
        return dr.gather(unsigned, unsigned(tile.ravel().tolist()), y * wide + x)

    def _check(self, image: Array) -> None:
        """Raise InputError for an image of another sensor."""
        shape = getattr(image, "shape", None)
        expected = (*self.shape, len(self.bands.responses))
        if shape is None or tuple(shape) != expected or not hasattr(image, "array"):
            raise InputError(
                f"image has shape {None if shape is None else tuple(shape)}; pass what mitsuba.render returns of this "
                f"sensor, {expected} (rows, columns, bands)."
            )
