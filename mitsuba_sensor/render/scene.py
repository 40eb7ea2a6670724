"""Load any Mitsuba 3 scene file and put the sensor's own film into it.

The file is parsed, not yet built, when film and sampler of its first sensor are replaced: a scene that has no idea of
us (rgb, any film, any filter) renders as spectral irradiance. Nothing else is touched, and notes tell what was.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..optics.f_number_law import View
from .bands import Bands, box_bands
from .film import focus_wavelengths, response_film
from .lens_sensor import put_lens
from .lint import SAMPLER, WRAPPERS, Finding, gravest_first, lint, lint_built
from .plugins import built_in
from .scene_file import SceneFile, in_one_sentence, parse_scene, plain
from .scene_settings import FILM, SENSOR, SENSOR_FIELDS, SIZE, SceneSettings, setup_of, unit_m
from .scene_spectra import Spectra
from .variants import mitsuba

if TYPE_CHECKING:
    from ..sensor.camera import Camera

SENSORS = ("perspective", "thinlens", "orthographic", SENSOR)
FILM_ID = "sensor"  # of the film that is put in, by which its sensor is known again
WIDTH, HEIGHT = 768, 576  # of Mitsuba's films by default
# What cannot be rendered here, and what to do about it.
UNSUITABLE = {
    "depth": "sees no light; use 'path'",
    "ptracer": "starts its paths at the lamps and cannot write spectral bands; use 'path'",
    "circular": "acts on polarised light, which is not simulated; leave it out",
    "polarizer": "acts on polarised light, which is not simulated; leave it out",
    "retarder": "acts on polarised light, which is not simulated; leave it out",
    "measured_polarized": "acts on polarised light, which is not simulated; use 'measured'",
}


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene ready to render into bands.

    view : what its sensor sees.  notes : what was replaced, what will be black.  findings : the same, one by one.
    """

    native: Any
    integrator: Any
    sensor: Any
    view: View
    sha256: str
    notes: tuple[str, ...]
    findings: tuple[Finding, ...] = ()

    def focus(self, low_nm: float, high_nm: float) -> None:
        """From now on draw wavelengths between two edges of the bands only."""
        focus_wavelengths(mitsuba(), self.sensor.film(), low_nm, high_nm)

    def render(self, seed: int, samples: int, rows: tuple[int, int]) -> NDArray[np.float32]:
        """One pass over rows [first, last) of the crop: ∫response·L dλ [W m⁻² sr⁻¹], (rows, columns, channels)."""
        (columns, _), (x, y) = self.view.crop_size, self.view.crop_offset
        film, size, place = self.sensor.film(), (columns, rows[1] - rows[0]), (x, y + rows[0])
        if tuple(film.crop_size()) != size or tuple(film.crop_offset()) != place:
            parameters = mitsuba().traverse(self.sensor)
            parameters["film.crop_size"], parameters["film.crop_offset"] = list(size), list(place)
            parameters.update()
        try:
            image = self.integrator.render(self.native, sensor=self.sensor, seed=seed, spp=samples)
        except RuntimeError as error:
            raise InputError(f"the scene cannot be rendered: {plain(error)}.") from error
        return np.array(image, dtype=np.float32).reshape(size[1], size[0], -1)


def load_scene(
    path: str | os.PathLike[str],
    bands: Bands,
    parameters: Mapping[str, Any],
    camera: Camera | None = None,
    scene_unit: str | float | None = None,
    *,
    width: int | None = None,
    sampler: str = SAMPLER,
) -> Scene:
    """Load ``path`` with a film of these channels; the variant must be set.

    bands : what its channels respond to.  parameters : values for the scene's ``<default>`` names.
    camera : whose lens stands before the film; by default the one that the scene file names, if any.
    scene_unit : "m", "mm", … or metres per unit; by default what the scene file says, else metres.
    width : the same view in so many columns of pixels, and rows in proportion; by default what the scene file says.
    sampler : the Mitsuba plugin that the light paths are drawn with.
    Raises InputError, one sentence, for whatever is wrong with the file.
    """
    scene = parse_scene(path, parameters)
    _refuse_unsuitable(scene)
    setup = setup_of(scene)
    camera, metres = camera or setup.camera, _unit(setup, scene_unit)
    findings, dark = _findings(scene, bands, metres)
    if dark:
        why = f"{findings[0].what}; give it an emitter with a spectrum there"
        raise InputError(f"scene {scene.path.name!r} has no light in the bands: {why}.")
    _put_camera(scene, replace(setup, unit_m=metres), camera)
    _put_film(scene, bands, film_size(scene, camera, width), sampler)
    _unwrap_integrator(scene)
    native = scene.build()
    if not native.emitters():
        raise InputError(f'scene {scene.path.name!r} has no light; add an emitter, e.g. <emitter type="constant"/>.')
    sensor = next(one for one in native.sensors() if one.film().id() == FILM_ID)
    integrator = native.integrator() or mitsuba().load_dict({"type": "path"})
    findings = gravest_first([*findings, *lint_built(scene, native, sensor)])
    view = _view(mitsuba(), sensor, metres or 1.0)
    sensor, view, bent = put_lens(sensor, view, camera, metres or 1.0)
    notes = (*(str(finding) for finding in findings), *bent)
    return Scene(native, integrator, sensor, view, scene.digest(), notes, tuple(findings))


def inspect_scene(
    path: str | os.PathLike[str],
    camera: Camera,
    parameters: Mapping[str, Any],
    scene_unit: str | float | None = None,
) -> tuple[Finding, ...]:
    """Everything worth knowing about a scene before ``camera`` looks at it; the variant must be set.

    The scene is built too, so that a missing mesh is an InputError here and not after an hour.
    """
    bands = box_bands(camera, np.array(camera.band_nm, dtype=float))
    scene = parse_scene(path, parameters)
    findings, dark = _findings(scene, bands, _unit(setup_of(scene), scene_unit))
    return tuple(findings) if dark else load_scene(path, bands, parameters, camera, scene_unit).findings


def _findings(scene: SceneFile, bands: Bands, metres: float | None) -> tuple[list[Finding], bool]:
    """What lint finds before building, and whether no light of the scene reaches the bands."""
    spectra = Spectra(mitsuba(), scene.state)
    findings = lint(scene, spectra, bands.low_nm, bands.high_nm, metres)
    return findings, bool(spectra.lights) and not spectra.lit(bands.low_nm, bands.high_nm)


def _unit(setup: SceneSettings, scene_unit: str | float | None) -> float | None:
    return setup.unit_m if scene_unit is None else unit_m(scene_unit)


def _refuse_unsuitable(scene: SceneFile) -> None:
    """InputError for a sensor, integrator or material that cannot give this picture."""
    mi, sensor = mitsuba(), scene.sensor()
    kind = sensor.props.plugin_name()
    if kind not in SENSORS:
        many = ", ".join(SENSORS)
        raise InputError(f"scene {scene.path.name!r} has a sensor of type {kind!r}; it must be one of {many}.")
    for node in scene.state.nodes:
        kind = node.props.plugin_name()
        if node.type in (mi.ObjectType.Integrator, mi.ObjectType.BSDF) and kind in UNSUITABLE:
            what = f"scene {scene.path.name!r}, {scene.where(node)}: {kind!r}"
            raise InputError(f"{what} {UNSUITABLE[kind]}.")


def _put_camera(scene: SceneFile, setup: SceneSettings, camera: Camera | None) -> None:
    """A <sensor type="camera"> becomes the sensor of Mitsuba that it stands for."""
    node, film = scene.sensor(), scene.film()
    if node.props.plugin_name() != SENSOR:
        return
    where = f"scene {scene.path.name!r}, {scene.where(node)}"
    if camera is None:
        raise InputError(f'{where}: a camera needs a <film type="{FILM}"> that names it, or --camera.')
    default = camera.sensor.columns if film and film.props.plugin_name() == FILM else WIDTH
    width = film.props["width"] if film and "width" in film.props else default
    try:
        kind, view = built_in(setup, camera, width)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    for name in SENSOR_FIELDS:
        if name in node.props:
            del node.props[name]
    node.props.set_plugin_name(kind)
    for name, value in view.items():
        node.props[name] = value


def film_size(scene: SceneFile, camera: Camera | None, width: int | None) -> dict[str, int]:
    """Width, height and crop of the first sensor's film, by the names of Mitsuba's parameters; scaled to ``width``."""
    film, size = scene.film(), {}
    if film is not None:
        if film.props.plugin_name() == FILM and camera is not None:
            size = {"width": camera.sensor.columns, "height": camera.sensor.rows}
        size |= {k: v for k, v in film.props.items() if k in SIZE}
    if width is None:
        return size
    full = size.get("width", WIDTH)
    if isinstance(width, bool) or not hasattr(width, "__index__") or not 1 <= width <= full:
        raise InputError(f"width is {width!r}; it must be a whole number from 1 to the film's own {full}.")
    whole = {"width": full, "height": size.get("height", HEIGHT), **size}
    return {k: max(round(v * width / full), 0 if "offset" in k else 1) for k, v in whole.items()}


def _put_film(scene: SceneFile, bands: Bands, size: dict[str, int], sampler: str) -> None:
    """Replace film and sampler of the first sensor; the others go."""
    mi, node = mitsuba(), scene.sensor()
    for name, child in list(scene.children(node.props)):
        if child.type in (mi.ObjectType.Film, mi.ObjectType.Sampler):
            del node.props[name]
    with in_one_sentence(scene.path):
        node.props["film"] = response_film(mi, bands.responses, {**size, "id": FILM_ID})
    node.props["sampler"] = mi.load_dict({"type": sampler})
    for name, child in list(scene.children(scene.root)):
        if child.type == mi.ObjectType.Sensor and child != node:
            del scene.root[name]


def _unwrap_integrator(scene: SceneFile) -> None:
    """Replace an integrator that adds channels by the one inside it."""
    mi = mitsuba()
    for name, node in list(scene.children(scene.root)):
        if node.type == mi.ObjectType.Integrator and node.props.plugin_name() in WRAPPERS:
            inner = [node.props[key] for key, child in scene.children(node.props) if child.type == node.type]
            scene.root[name] = inner[0] if inner else mi.load_dict({"type": "path"})


def _view(mi: Any, sensor: Any, metres: float) -> View:
    """The geometry of a built sensor; Mitsuba has already turned fov_axis or focal_length into x_fov.

    metres : per scene unit.
    """
    parameters, film = mi.traverse(sensor), sensor.film()

    def value(name: str, default: float) -> float:  # Dr.Jit scalars are arrays of one
        return float(np.ravel(parameters[name])[0]) if name in parameters else default

    def pair(vector: Any) -> tuple[int, int]:
        return int(vector[0]), int(vector[1])

    if 0 in pair(film.crop_size()):
        raise InputError(f"the film has {film.crop_size()[0]} × {film.crop_size()[1]} pixels; it needs at least 1 × 1.")

    return View(
        size=pair(film.size()),
        crop_size=pair(film.crop_size()),
        crop_offset=pair(film.crop_offset()),
        half_width=math.tan(math.radians(value("x_fov", 0.0)) / 2),
        principal_point=(value("principal_point_offset_x", 0.0), value("principal_point_offset_y", 0.0)),
        focus_m=value("focus_distance", math.inf) * metres,
        aperture_radius_m=value("aperture_radius", 0.0) * metres,
    )
