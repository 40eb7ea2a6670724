"""Load any Mitsuba 3 scene file and put the sensor's own film into it.

The file is parsed, not yet built, when film and sampler of its first sensor are replaced: a scene that has no idea of
us (rgb, any film, any filter) renders as spectral irradiance. Nothing else is touched, and notes tell what was.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..engine.errors import InputError, nearest
from .bands import Bands
from .film import response_film
from .lint import Spectra
from .optics import View
from .variants import mitsuba

SAMPLER = "multijitter"  # at 64 samples per pixel a quarter of the noise of "independent", at the same cost
SENSORS = ("perspective", "thinlens", "orthographic")
WRAPPERS = ("aov", "moment", "stokes")  # integrators that add channels; with specfilm they corrupt memory (#1189)
FILM_KEYS = ("width", "height", "crop_width", "crop_height", "crop_offset_x", "crop_offset_y")


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene ready to render into bands.

    view : what its sensor sees.  notes : what was replaced, what will be black.
    """

    native: Any
    integrator: Any
    sensor: Any
    view: View
    sha256: str
    notes: tuple[str, ...]

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
            raise InputError(f"the scene cannot be rendered: {_plain(error)}.") from error
        return np.array(image, dtype=np.float32).reshape(size[1], size[0], -1)


def load_scene(path: str | os.PathLike[str], bands: Bands, parameters: Mapping[str, Any]) -> Scene:
    """Load ``path`` with a film of these channels; the variant must be set.

    bands : what its channels respond to.  parameters : values for the scene's ``<default>`` names.
    Raises InputError, one sentence, for whatever is wrong with the file.
    """
    file, mi = Path(path), mitsuba()
    if not file.is_file():
        raise InputError(f"scene {os.fspath(path)!r} is not a file; give the path of a Mitsuba 3 scene in XML.")
    values = {str(k): str(v) for k, v in parameters.items()}
    _check_parameters(file, values)
    config = mi.parser.ParserConfig(mi.variant())
    with _folder_of(file):
        with _in_one_sentence(file):
            state = mi.parser.parse_file(config, str(file), **values)
            mi.parser.transform_upgrade(config, state)
            mi.parser.transform_resolve(config, state)
        notes: list[str] = []
        sensor = _first_sensor(mi, state, file, notes)
        _put_film(mi, state, sensor, file, bands, notes)
        _unwrap_integrator(mi, state, file, notes)
        notes += _check_light(mi, state, file, bands)
        with _in_one_sentence(file):
            mi.parser.transform_all(config, state)
            built = mi.parser.instantiate(config, state)
    native = built[0] if isinstance(built, list) else built
    if not native.emitters():
        raise InputError(f'scene {file.name!r} has no light; add an emitter, e.g. <emitter type="constant"/>.')
    sensor, integrator = native.sensors()[0], native.integrator() or mi.load_dict({"type": "path"})
    return Scene(native, integrator, sensor, _view(mi, sensor), _digest(state, values), tuple(notes))


def _check_parameters(file: Path, values: Mapping[str, str]) -> None:
    """A parameter that the scene does not have is a typing error. (Names in included files are left to Mitsuba.)"""
    text = file.read_text(encoding="utf-8", errors="replace")
    known = sorted(set(re.findall(r'<default\s+name="(\w+)"', text)) | set(re.findall(r"\$\{?(\w+)", text)))
    for name in values:
        if name not in known and "<include" not in text:
            has = f"it has {', '.join(known)}" if known else "it has none"
            raise InputError(f"scene {file.name!r} has no parameter {name!r}; {has}.{nearest(name, known)}")


def _first_sensor(mi: Any, state: Any, file: Path, notes: list[str]) -> int:
    """Index of the node of the scene's first sensor."""
    if state.nodes[0].type != mi.ObjectType.Scene:
        raise InputError(f'{file.name!r} holds no scene; its outermost element must be <scene version="3.0.0">.')
    indices = [i for i, node in enumerate(state.nodes) if node.type == mi.ObjectType.Sensor]
    if not indices:
        raise InputError(f'scene {file.name!r} has no sensor; add one, e.g. <sensor type="perspective">.')
    kind = state.nodes[indices[0]].props.plugin_name()
    if kind not in SENSORS:
        raise InputError(f"scene {file.name!r} has a sensor of type {kind!r}; it must be one of {', '.join(SENSORS)}.")
    if len(indices) > 1:
        notes.append(f"the scene has {len(indices)} sensors; the first one was taken")
    return indices[0]


def _children(mi: Any, state: Any, props: Any) -> Iterator[tuple[str, Any]]:
    """(name, node) of the objects nested in a node."""
    for name, value in list(props.items()):
        if isinstance(value, mi.Properties.ResolvedReference):
            yield name, state.nodes[value.index()]


def _put_film(mi: Any, state: Any, sensor: int, file: Path, bands: Bands, notes: list[str]) -> None:
    """Replace film and sampler of the sensor node."""
    props, size = state.nodes[sensor].props, {}
    for name, child in _children(mi, state, props):
        if child.type == mi.ObjectType.Film:
            size = {k: v for k, v in child.props.items() if k in FILM_KEYS}
            notes += _film_notes(mi, state, child)
        elif child.type == mi.ObjectType.Sampler:
            if child.props.plugin_name() != SAMPLER:
                notes.append(f"sampler {child.props.plugin_name()!r} replaced by {SAMPLER!r}")
        else:
            continue
        del props[name]
    with _in_one_sentence(file):
        props["film"] = response_film(mi, bands.responses, size)
    props["sampler"] = mi.load_dict({"type": SAMPLER})


def _film_notes(mi: Any, state: Any, film: Any) -> list[str]:
    """Say that another film than a specfilm, or a filter wider than a pixel, was replaced, and that a crop was kept."""
    kind, notes = film.props.plugin_name(), []
    children = (child for _, child in _children(mi, state, film.props))
    filters = [c.props.plugin_name() for c in children if c.type == mi.ObjectType.ReconstructionFilter]
    if kind != "specfilm":
        notes.append(f"film {kind!r} replaced by the spectral bands of the sensor (specfilm, float32)")
    if filters != ["box"]:
        notes.append(f"filter {(filters or ['gaussian'])[0]!r} replaced by 'box': a pixel sees itself only")
    if any(name.startswith("crop") for name in dict(film.props.items())):
        notes.append("only the crop window of the film is rendered")
    return notes


def _unwrap_integrator(mi: Any, state: Any, file: Path, notes: list[str]) -> None:
    """Replace an integrator that adds channels by the one inside it."""
    root = state.nodes[0].props
    for name, node in _children(mi, state, root):
        kind = node.props.plugin_name() if node.type == mi.ObjectType.Integrator else ""
        if kind == "depth":
            raise InputError(f"scene {file.name!r} has a 'depth' integrator, which sees no light; use 'path'.")
        if kind in WRAPPERS:
            inner = [v for _, v in node.props.items() if isinstance(v, mi.Properties.ResolvedReference)]
            root[name] = inner[0] if inner else mi.load_dict({"type": "path"})
            notes.append(f"integrator {kind!r} replaced by {'the one inside it' if inner else 'path'}")


def _check_light(mi: Any, state: Any, file: Path, bands: Bands) -> list[str]:
    """Notes about black spectra; InputError if no light reaches the band at all."""
    spectra, low, high = Spectra(mi, state), bands.low_nm, bands.high_nm
    notes = spectra.dark(low, high)
    if spectra.lights and not spectra.lit(low, high):
        why = f"{notes[0]}; give it an emitter with a spectrum there"
        raise InputError(f"scene {file.name!r} has no light in the bands: {why}.")
    return notes


def _view(mi: Any, sensor: Any) -> View:
    """The geometry of a built sensor; Mitsuba has already turned fov_axis or focal_length into x_fov."""
    parameters, film = mi.traverse(sensor), sensor.film()

    def value(name: str, default: float) -> float:  # Dr.Jit scalars are arrays of one
        return float(np.ravel(parameters[name])[0]) if name in parameters else default

    def pair(vector: Any) -> tuple[int, int]:
        return int(vector[0]), int(vector[1])

    return View(
        size=pair(film.size()),
        crop_size=pair(film.crop_size()),
        crop_offset=pair(film.crop_offset()),
        half_width=math.tan(math.radians(value("x_fov", 0.0)) / 2),
        principal_point=(value("principal_point_offset_x", 0.0), value("principal_point_offset_y", 0.0)),
        focus_m=value("focus_distance", math.inf),
        aperture_radius_m=value("aperture_radius", 0.0),
    )


def _digest(state: Any, parameters: Mapping[str, str]) -> str:
    """SHA-256 over the parameters, the scene file and its includes; not over meshes and pictures."""
    digest = hashlib.sha256(json.dumps(sorted(parameters.items())).encode())
    for file in state.files:
        digest.update(Path(str(file)).read_bytes())
    return digest.hexdigest()


@contextlib.contextmanager
def _folder_of(file: Path) -> Iterator[None]:
    """Let Mitsuba find meshes and pictures beside the scene file, and forget the folder afterwards."""
    mi = mitsuba()
    before = mi.file_resolver()
    mine = type(before)(before)
    mine.prepend(str(file.resolve().parent))
    mi.set_file_resolver(mine)
    try:
        yield
    finally:
        mi.set_file_resolver(before)


@contextlib.contextmanager
def _in_one_sentence(file: Path) -> Iterator[None]:
    """Turn what Mitsuba raises about a file into an InputError."""
    try:
        yield
    except RuntimeError as error:
        begin, name = "At|While loading|Error while loading|Parsing of XML file", re.escape(str(file))
        where = rf'(?:{begin}) "?{name}"?(?: failed:)? '
        text = re.sub(where, "", _plain(error))
        remedy = "; give it a value (-D name=value)" if "undefined parameter" in text else ""
        raise InputError(f"scene {file.name!r} cannot be loaded: {text}{remedy}.") from error


def _plain(error: BaseException) -> str:
    """Mitsuba's message without its source lines and line breaks."""
    text = re.sub(r"\[\w+\.(?:cpp|h|py):\d+\]\s*", "", str(error))
    return re.sub(r"\s+", " ", text).strip().rstrip(".!")
