"""Raw frames from plain Mitsuba: a film that contains digital numbers, and the integrator that fills it.

``<film type="photosensor"><string name="output" value="raw"/>`` is such a film; ``<integrator type="raw_frame">``
renders the scene with the integrator inside it and exposes the camera. Then ``mi.render``, ``film.develop()``,
``film.bitmap()`` and ``film.write()`` return the raw frame. Both are Python classes, one for each variant.
"""

from __future__ import annotations

from functools import cache, wraps
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core import InputError
from ...sensor.expose import exposure_of_photons
from ..light.photons import collected
from ..passes.prepared import render as render_light
from ..scene.loaded_scene import LoadedView
from ..scene.plugin_parameters import PluginParameters
from ..variants import MitsubaObject, mitsuba

RAW = "raw"  # value of the parameter output
NO_DERIVATIVE = (
    'the digital numbers of a raw frame have no derivative; render the light with a photosensor of output "bands" and '
    "without raw_frame, and use mitsuba_sensor.differentiable for the sensor."
)


def raw_film(bands: MitsubaObject, parameters: PluginParameters) -> MitsubaObject:
    """Return a raw film with the size of the film of the bands."""
    mi = mitsuba()
    _end_with_own_sentence(mi)
    props = mi.Properties("photosensor")
    for name, value in _size_of(bands).items():
        props[name] = value
    props["rfilter"] = mi.load_dict({"type": "box"})
    film = _film_class(mi.variant())(props)
    film.set_id(parameters.id())
    return film


def _size_of(film: MitsubaObject) -> dict[str, int]:
    """Return the size and crop parameters of a film."""
    names = "width", "height", "crop_width", "crop_height", "crop_offset_x", "crop_offset_y"
    numbers = *film.size(), *film.crop_size(), *film.crop_offset()
    return {name: int(number) for name, number in zip(names, numbers, strict=True)}


def raw_frame(props: MitsubaObject) -> MitsubaObject:
    """Return <integrator type="raw_frame"> around the nested integrator, by default path."""
    mi = mitsuba()
    _end_with_own_sentence(mi)
    nested = [props[name] for name in props if props.type(name) == mi.Properties.Type.Object]
    inner = next((x for x in nested if isinstance(x, mi.Integrator)), None)
    level = mi.log_level()
    # Mitsuba warns that Python is slow in scalar variants, but no ray is traced here.
    mi.set_log_level(mi.LogLevel.Error)
    try:
        inner = mi.load_dict({"type": "path"}) if inner is None else inner
        return _integrator_class(mi.variant())(props, inner)
    finally:
        mi.set_log_level(level)


@cache
def _end_with_own_sentence(mi: MitsubaObject) -> None:
    """Let mi.render raise the InputError of a raw frame directly: in variants with derivatives drjit.custom raises a
    RuntimeError, and its cause is thirty lines above the end of the traceback."""
    inner = mi.render

    @wraps(inner)
    def render(*arguments: object, **options: object) -> MitsubaObject:
        try:
            return inner(*arguments, **options)
        except RuntimeError as error:
            if isinstance(error.__cause__, InputError):
                raise error.__cause__ from None
            raise

    mi.render = render


@cache
def _film_class(variant: str) -> MitsubaObject:
    """Return the class of the film; Mitsuba has another base class in every variant."""
    mi = mitsuba()
    assert mi.variant() == variant
    base: MitsubaObject = mi.Film

    class RawFilm(base):  # type: ignore[misc]
        """digital : the rendered frame, shape (H, W) [DN]."""

        digital: NDArray[np.unsignedinteger] | None = None

        def prepare(self, aovs: Any) -> int:
            """Reject an integrator that fills the film with samples."""
            raise InputError(
                'a photosensor of output "raw" needs <integrator type="raw_frame">; put the integrator of the scene '
                "into it, or omit output for the light of each band."
            )

        def develop(self, raw: bool = False) -> MitsubaObject:
            """Return the raw frame, shape (H, W, 1) [DN], regardless of ``raw``."""
            return mi.TensorXf(self._frame().astype(np.float32)[..., None])

        def bitmap(self, raw: bool = False) -> MitsubaObject:
            """The raw frame as whole numbers."""
            return mi.Bitmap(self._frame()[..., None])

        def write(self, path: Any) -> None:
            """Write the raw frame: float32 in an EXR, else whole numbers of 16 bits, in a PNG for example."""
            digital = self._frame()
            dtype = np.float32 if str(path).lower().endswith(".exr") else np.uint16
            if digital.max(initial=0) > np.iinfo(np.uint16).max and dtype is np.uint16:
                raise InputError(
                    f"the raw frame has numbers up to {digital.max()}, and {path} holds 16 bits; write an EXR."
                )
            mi.Bitmap(digital.astype(dtype)[..., None]).write(str(path))

        def clear(self) -> None:
            """Forget the frame."""
            self.digital = None

        def to_string(self) -> str:
            """For people."""
            return f"RawFilm[size = {list(self.size())}, rendered = {self.digital is not None}]"

        def _frame(self) -> NDArray[np.unsignedinteger]:
            if self.digital is None:
                raise InputError(
                    "the film holds no raw frame yet; render the scene first, e.g. mi.render(scene)."
                )
            return self.digital

    return RawFilm


@cache
def _integrator_class(variant: str) -> MitsubaObject:
    mi = mitsuba()
    assert mi.variant() == variant
    base: MitsubaObject = mi.SamplingIntegrator

    class RawFrame(base):  # type: ignore[misc]
        """inner : renders the light."""

        def __init__(self, props: MitsubaObject, inner: MitsubaObject) -> None:
            super().__init__(props)
            self.inner = inner

        def render(
            self,
            scene: MitsubaObject,
            sensor: MitsubaObject = 0,
            seed: Any = 0,
            spp: int = 0,
            develop: bool = True,
            evaluate: bool = True,
        ) -> MitsubaObject:
            """Return the raw frame of a sensor, (H, W, 1) [DN], which its film holds too. seed : of all noise."""
            chosen = scene.sensors()[sensor] if isinstance(sensor, int) else sensor
            film = chosen.film()
            if not hasattr(film, "digital"):
                raise InputError(
                    'raw_frame renders a sensor with a <film type="photosensor"> of output "raw".'
                )
            samples = spp or int(chosen.sampler().sample_count())
            first_seed, view = int(np.ravel(seed)[0]), LoadedView(scene, chosen, self.inner)
            light = render_light(view, seed=first_seed, spp=samples)
            photons, camera, exposure, serial = collected(light, None, None, None, None)
            exposed = exposure_of_photons(
                photons, camera, exposure, {"serial": serial, "seed": first_seed}
            )
            film.digital = np.asarray(exposed.frames().digital[0])
            return film.develop()

        def render_forward(self, *scene: object, **options: object) -> MitsubaObject:
            """Whole numbers have no derivative."""
            raise InputError(NO_DERIVATIVE)

        def render_backward(self, *scene: object, **options: object) -> None:
            """Whole numbers have no derivative."""
            raise InputError(NO_DERIVATIVE)

        def aov_names(self) -> list[str]:
            """None."""
            return []

        def to_string(self) -> str:
            """For people."""
            return f"RawFrame[{self.inner}]"

    return RawFrame
