"""The parameters of <film type="photosensor"> and <sensor type="camera">: name, XML, unit, default, meaning.

A film of Mitsuba can carry no data except its id, so the id of the built film contains the parameters of both elements
(:class:`PluginParameters`).
"""

from __future__ import annotations

import json
from typing import Any, NamedTuple

from ..variants import MitsubaObject
from .mitsuba_errors import OWN_PLUGINS

_, FILM, _ = OWN_PLUGINS


class PluginParameters(NamedTuple):
    """Parameters of the photosensor (film) and of the camera around it (sensor); None without a camera."""

    film: dict[str, Any]
    sensor: dict[str, Any] | None = None

    def id(self) -> str:
        """Return the parameters as the id of a film."""
        return f"{FILM} {json.dumps(self._asdict())}"


def parameters_of(film: MitsubaObject) -> PluginParameters | None:
    """Return the parameters of a film that a photosensor became; None for any other film."""
    kind, _, text = film.id().partition(" ")
    return PluginParameters(**json.loads(text)) if kind == FILM and text else None


class PluginParameter(NamedTuple):
    """One parameter.  element : of the XML file.  example : a valid value.  unit : empty for a number without unit."""

    name: str
    element: str
    example: str
    unit: str
    default: str
    meaning: str

    @property
    def xml(self) -> str:
        """The element, ``<float name="f_number" value="2.8"/>``; a transform contains its example."""
        if self.element == "transform":
            return f'<transform name="{self.name}">{self.example}</transform>'
        return f'<{self.element} name="{self.name}" value="{self.example}"/>'


P = PluginParameter
OF_CAMERA, OF_SENSOR, MITSUBA = "the camera's", "the whole sensor", "Mitsuba's"

EXPOSURE_PARAMETERS = (
    P(
        "exposure_s",
        "float",
        "0.1",
        "s",
        "metered",
        "exposure time; the string `auto` is also metered",
    ),
    P(
        "meter",
        "string",
        "50:0.3",
        "",
        "`95:0.7`",
        "instead of an exposure time: percentile of the lit pixels and the fraction of "
        "saturation that it reaches",
    ),
    P("temperature_k", "float", "298.15", "K", "`298.15`", "temperature of the sensor"),
    P("seed", "integer", "1", "", "`1`", "seed of the render and of all temporal noise"),
    P(
        "serial",
        "integer",
        "7",
        "",
        "`1`",
        "serial number of the camera: selects its fixed-pattern noise",
    ),
    P(
        "wavelength_nm",
        "float",
        "550",
        "nm",
        "all that the camera detects",
        "render one band only, about this one",
    ),
    P("bandwidth_nm", "float", "20", "nm", "`10`", "width of a spectral band"),
    P(
        "spectral",
        "string",
        "cube",
        "",
        "`auto`",
        "`auto`, `cube` or `channels`, as `--spectral`",
    ),
)

SIZE_PARAMETERS = (
    P("width", "integer", "16", "pixels", OF_SENSOR, "columns of the image"),
    P("height", "integer", "12", "pixels", OF_SENSOR, "rows of the image"),
    P(
        "crop_width",
        "integer",
        "8",
        "pixels",
        "the width",
        "columns of a window of the image",
    ),
    P("crop_height", "integer", "6", "pixels", "the height", "rows of that window"),
    P("crop_offset_x", "integer", "2", "pixels", "`0`", "first column of that window"),
    P("crop_offset_y", "integer", "4", "pixels", "`0`", "first row of that window"),
)

FILM_PARAMETERS = (
    P(
        "camera",
        "string",
        "sony_a7s2",
        "",
        "required",
        "name of a camera, or a .toml beside the scene file",
    ),
    P(
        "gain",
        "string",
        "3200",
        "",
        OF_CAMERA,
        "gain setting of that camera: an ISO number or a name",
    ),
    P(
        "output",
        "string",
        "bands",
        "",
        "`bands`",
        "for plain Mitsuba: `bands` of light, or `raw` digital numbers",
    ),
    *EXPOSURE_PARAMETERS,
    *SIZE_PARAMETERS,
)
"""Every key of a camera file is also a parameter, by its dotted name."""

LENS_PARAMETERS = {
    "lens.f_number": P(
        "f_number",
        "float",
        "2.8",
        "",
        OF_CAMERA,
        "focal length over diameter of the entrance pupil",
    ),
    "lens.convention": P(
        "pupil_convention",
        "string",
        "working",
        "",
        OF_CAMERA,
        "`working`, or `planar` as in EMVA 1288",
    ),
    "lens.pupil_magnification": P(
        "pupil_magnification",
        "float",
        "1.1",
        "",
        OF_CAMERA,
        "diameter of the exit pupil over diameter of the entrance pupil",
    ),
}
"""Field of a camera file → the parameter that sets it."""

PASSED_ON_PARAMETERS = (
    P("to_world", "transform", '<lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/>', "", "at the origin, "
      "looking along +z", "position and direction of the camera"),
    P("near_clip", "float", "0.01", "scene units", MITSUBA, "nothing nearer than this is in the image"),
    P("far_clip", "float", "1000", "scene units", MITSUBA, "nothing farther than this is in the image"),
    P("principal_point_offset_x", "float", "0.1", "image widths", "`0`", "shift of the lens along the rows"),
    P("principal_point_offset_y", "float", "0.1", "image heights", "`0`", "shift of the lens along the columns"),
)  # fmt: skip
"""Parameters of Mitsuba's perspective sensor, unchanged."""

SENSOR_PARAMETERS = (
    P(
        "focal_length_mm",
        "float",
        "25",
        "mm",
        "required",
        "focal length; with the pixel pitch, the field of view",
    ),
    P(
        "focus_distance_m",
        "float",
        "2",
        "m",
        "everything is sharp",
        "distance of objects in focus",
    ),
    *LENS_PARAMETERS.values(),
    P(
        "transmission",
        "spectrum",
        "400:0.9, 700:0.95",
        "",
        OF_CAMERA,
        "T(λ) of the lens; or one number as a float",
    ),
    P(
        "scene_unit",
        "string",
        "cm",
        "",
        "`m`",
        "what a length of 1 in the scene is: m, mm, …, or metres",
    ),
)
