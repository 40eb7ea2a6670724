"""Raw frames out of plain Mitsuba: a film that holds digital numbers, and the integrator that fills it.

``<film type="photosensor"><string name="output" value="raw"/>`` is such a film; ``<integrator type="raw_frame">``
around another one renders the scene with that one and exposes the camera. Then ``mi.render`` returns the raw frame, and
``film.develop()``, ``film.bitmap()`` and ``film.write()`` have it. Both are classes of Python, one for each variant.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core import InputError
from ..sensor.expose import expose
from .plugin_id import PluginParameters
from .variants import MitsubaObject, mitsuba

RAW = "raw"  # of the parameter output


def raw_film(bands: MitsubaObject, parameters: PluginParameters) -> MitsubaObject:
    """A film of the size of the film of the bands."""
    mi = mitsuba()
    props = mi.Properties("photosensor")
    (width, height), (columns, rows), (x, y) = bands.size(), bands.crop_size(), bands.crop_offset()
    names = "width", "height", "crop_width", "crop_height", "crop_offset_x", "crop_offset_y"
    for name, value in zip(names, (width, height, columns, rows, x, y), strict=True):
        props[name] = int(value)
    props["rfilter"] = mi.load_dict({"type": "box"})
    film = _film_class(mi.variant())(props)
    film.set_id(parameters.id())
    return film


def raw_frame(props: MitsubaObject) -> MitsubaObject:
    """<integrator type="raw_frame"> around another integrator; by default around path."""
    mi = mitsuba()
    nested = [props[name] for name in props if props.type(name) == mi.Properties.Type.Object]
    inner = next((one for one in nested if isinstance(one, mi.Integrator)), None)
    level = mi.log_level()
    mi.set_log_level(mi.LogLevel.Error)  # Mitsuba warns that Python is slow in scalar variants; it traces no ray here
    try:
        return _integrator_class(mi.variant())(props, mi.load_dict({"type": "path"}) if inner is None else inner)
    finally:
        mi.set_log_level(level)


@cache
def _film_class(variant: str) -> MitsubaObject:
    """The film's class; Mitsuba has another base class in every variant."""
    mi = mitsuba()
    assert mi.variant() == variant
    base: MitsubaObject = mi.Film

    class RawFilm(base):  # type: ignore[misc]
        """digital : the frame (H, W) [DN], once it is rendered."""

        digital: NDArray[np.unsignedinteger] | None = None

        def prepare(self, aovs: Any) -> int:
            """Called by an integrator that cannot fill it."""
            way_out = "put the integrator of the scene into one, or leave output out for the light of each band"
            raise InputError(f'a photosensor of output "raw" needs <integrator type="raw_frame">; {way_out}.')

        def develop(self, raw: bool = False) -> MitsubaObject:
            """The raw frame, (H, W, 1) [DN]; it is the same whether raw or not."""
            return mi.TensorXf(self._frame().astype(np.float32)[..., None])

        def bitmap(self, raw: bool = False) -> MitsubaObject:
            """The raw frame as whole numbers."""
            return mi.Bitmap(self._frame()[..., None])

        def write(self, path: Any) -> None:
            """The raw frame as float32, in an EXR for example."""
            mi.Bitmap(self._frame().astype(np.float32)[..., None]).write(str(path))

        def clear(self) -> None:
            """Forget the frame."""
            self.digital = None

        def base_channels_count(self) -> int:
            """One, the digital numbers."""
            return 1

        def schedule_storage(self) -> None:
            """Nothing waits."""

        def to_string(self) -> str:
            """For people."""
            return f"RawFilm[size = {list(self.size())}, rendered = {self.digital is not None}]"

        def _frame(self) -> NDArray[np.unsignedinteger]:
            if self.digital is None:
                raise InputError("the film holds no raw frame yet; render the scene first, e.g. mi.render(scene).")
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
            """The raw frame of the first sensor, (H, W, 1) [DN], which its film holds too. seed : of all noise."""
            from .prepared import render

            first = scene.sensors()[0]
            film = first.film()
            if not hasattr(film, "digital") or sensor not in (0, first):
                raise InputError(
                    'raw_frame renders the first sensor, with a <film type="photosensor"> of output "raw".'
                )
            number = int(np.ravel(seed)[0])
            light = render(scene, seed=number, spp=spp or int(first.sampler().sample_count()))
            film.digital = expose(light, seed=number).digital[0]
            return film.develop()

        def aov_names(self) -> list[str]:
            """None."""
            return []

        def to_string(self) -> str:
            """For people."""
            return f"RawFrame[{self.inner}]"

    return RawFrame
