"""Charts as Mitsuba scenes, and their light: rendered once for a camera's optics and kept in the user's cache.

Charts are emitting rectangles in front of a telecentric lens; the unit of length is the pixel pitch.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from ...camera.camera import Camera
from ...core import Exposure
from ...core.types import Float64Array
from ...core.versions import versions
from ...files.openexr import Plane, write_planes
from ...files.user_cache import keep, read_kept
from ...render.light.photons import photons_per_irradiance
from ...render.passes.prepared import render
from ...render.variants import choose_variant

UNIFORM = '<spectrum name="radiance" type="uniform"><float name="value" value="{value:.9g}"/></spectrum>'
DAYLIGHT = (
    '<spectrum name="radiance" type="d65"><float name="scale" value="{value:.9g}"/></spectrum>'
)
"""Radiance of a lamp with a flat spectrum and with CIE D65."""
BITMAP_FILE = "{bitmap}"
"""Placeholder for the file of a bitmap in the text of a scene."""
REPEATS = 3
"""Repeats of a bitmap along each side: light from beyond the image continues the bitmap."""
KEPT = "data", "wavelengths_nm", "bandwidths_nm", "standard_error"
RENDERERS = "mitsuba-sensor", "mitsuba", "drjit"
"""Packages whose versions affect the light."""
PITCHES = "pitch_x_um", "pitch_y_um"
NARROW_NM = 10.0
"""Bandwidth of a chart with one wavelength."""


class Bands(NamedTuple):
    """Centres and widths of spectral bands [nm], (B,)."""

    wavelengths_nm: Float64Array
    bandwidths_nm: Float64Array


class ChartScene(NamedTuple):
    """A chart as a scene.

    name : of the kept light.  text : the XML, or the name of an included scene.  samples : per pixel.
    wavelength_nm : of the only band; None for all bands that the camera detects.
    width : columns of the image; None for the scene's own.
    pixels : of the camera along each side of an image pixel.
    bitmap : radiance at the points of a bitmap, from the top, which replaces BITMAP_FILE in the text.
    """

    name: str
    text: str
    samples: int
    wavelength_nm: float | None = None
    width: int | None = None
    pixels: float = 1.0
    bitmap: Float64Array | None = None

    def seen_by(self, camera: Camera) -> Camera:
        """Return the camera with the pixel pitch of the image."""
        if self.pixels == 1:
            return camera
        pitch = {f"pixel.{name}": getattr(camera.pixel, name) * self.pixels for name in PITCHES}
        return camera.replace(**pitch)


class ChartLight(NamedTuple):
    """Irradiance of a chart.

    data : shape (H, W, B) [W m⁻² nm⁻¹].  bands : its spectral bands.
    standard_error : of the render, shape (H, W, B), same unit.
    """

    data: Float64Array
    bands: Bands
    standard_error: Float64Array

    def photons(
        self, camera: Camera, exposure: Exposure, irradiance: Float64Array
    ) -> Float64Array:
        """Return the mean photons per pixel in one exposure to irradiance (…, B) in these bands."""
        return np.asarray(irradiance * photons_per_irradiance(camera, exposure, *self.bands))

    @property
    def render_noise_percent(self) -> float:
        """Root mean square of the render noise over the brightest light [%]."""
        widths = self.bands.bandwidths_nm
        noise = np.sqrt(np.square(self.standard_error * widths).sum(axis=-1))
        return 100 * float(np.sqrt(np.square(noise).mean()) / (self.data @ widths).max())


def light_of(scene: ChartScene, camera: Camera) -> ChartLight:
    """Return the light of a chart for a camera's lens and pixels; render and keep it if it is not kept yet."""
    name = kept_name(scene, camera)
    kept = read_kept(name)
    if kept is None:
        keep(name, kept := _rendered(scene, camera))
    bands = Bands(kept["wavelengths_nm"], kept["bandwidths_nm"])
    data, error = (kept[name].astype(np.float64) for name in ("data", "standard_error"))
    return ChartLight(data, bands, error)


def kept_name(scene: ChartScene, camera: Camera) -> str:
    """Return the name under which the light of a chart is kept."""
    return f"chart-{scene.name}-{fingerprint(scene, camera)}"


def fingerprint(scene: ChartScene, camera: Camera) -> str:
    """Return a hash of everything that affects the light: chart, lens, pixels, bands and renderer."""
    pixel, version_of = camera.pixel, versions()
    parts = (
        scene._replace(bitmap=None),
        scene.bitmap is not None and hashlib.blake2b(scene.bitmap.tobytes()).hexdigest(),
        sorted(camera.lens.model_dump(mode="json").items()),
        (pixel.pitch_x_um, pixel.pitch_y_um, pixel.aperture_shape),
        (pixel.angular_response, pixel.angular_response_deg),
        (pixel.microlens_cra_deg, pixel.microlens_cra_heights_mm),
        camera.band_nm,
        choose_variant().name,
        [version_of[name] for name in RENDERERS],
    )
    return hashlib.blake2b(repr(parts).encode(), digest_size=8).hexdigest()


@contextmanager
def _text_of(scene: ChartScene) -> Iterator[str]:
    """Yield the text of a scene, with its bitmap in a temporary file."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "bitmap.exr"
        if scene.bitmap is not None:
            write_planes(file, {}, {"Y": Plane(scene.bitmap[::-1])})  # EXR starts at the bottom
        yield scene.text.replace(BITMAP_FILE, str(file))


def _rendered(scene: ChartScene, camera: Camera) -> dict[str, np.ndarray]:
    """Render the arrays to keep."""
    band = {}
    if scene.wavelength_nm is not None:
        band = {"wavelength_nm": scene.wavelength_nm, "bandwidth_nm": NARROW_NM}
    with _text_of(scene) as text:
        light = render(
            text,
            scene.seen_by(camera),
            Exposure(1.0),
            seed=1,
            progress=False,
            spp=scene.samples,
            spectral="cube",
            denoise=False,
            width=scene.width,
            **band,  # type: ignore[arg-type]
        )
    return {name: getattr(light, name) for name in KEPT}


def telecentric_scene(shape: tuple[int, int], elements: Iterable[str]) -> str:
    """Return the XML of a scene.  shape : rows and columns of the image, which is centred on (0, 0)."""
    half = shape[1] / 2
    sensor = (
        f'<sensor type="orthographic"><transform name="to_world"><scale x="{half:g}" y="{half:g}"/>'
        '<lookat origin="0, 0, 1" target="0, 0, 0" up="0, 1, 0"/></transform>'
    )
    return _scene(sensor, shape, elements)


def surrounded_scene(shape: tuple[int, int], field_deg: float) -> str:
    """Return the XML of uniform light from all directions.  field_deg : horizontal field of view."""
    sensor = f'<sensor type="perspective"><float name="fov" value="{field_deg:g}"/>'
    emitter = f'<emitter type="constant">{UNIFORM.format(value=1.0)}</emitter>'
    return _scene(sensor, shape, [emitter])


def _scene(sensor: str, shape: tuple[int, int], elements: Iterable[str]) -> str:
    """Return the XML of a scene.  sensor : the start of its element, without film and sampler."""
    rows, columns = shape
    return f"""<scene version="3.0.0">
<integrator type="path"><integer name="max_depth" value="1"/></integrator>
{sensor}
<film type="specfilm"><integer name="width" value="{columns}"/><integer name="height" value="{rows}"/>
<string name="component_format" value="float32"/><rfilter type="box"/></film>
<sampler type="multijitter"/>
</sensor>
{"".join(elements)}</scene>"""


def emitter_rectangle(
    middle: tuple[float, float],
    half: tuple[float, float],
    turned_deg: float,
    radiance: float,
    spectrum: str = UNIFORM,
) -> str:
    """Return the XML of a rectangle that emits towards the camera.

    middle, half : its middle and half its sides, before it turns about (0, 0) by ``turned_deg``, anticlockwise.
    """
    return (
        f'<shape type="rectangle"><transform name="to_world"><scale x="{half[0]:g}" y="{half[1]:g}"/>'
        f'<translate x="{middle[0]:g}" y="{middle[1]:g}"/><rotate z="1" angle="{turned_deg:g}"/></transform>'
        f'<emitter type="area">{spectrum.format(value=radiance)}</emitter></shape>\n'
    )


def bitmap_lamp(shape: tuple[int, int]) -> str:
    """Return the XML of a lamp whose radiance is a bitmap, which fills the image and repeats beyond it."""
    rows, columns = shape
    return (
        f'<shape type="rectangle"><transform name="to_world"><scale x="{REPEATS * columns / 2:g}" '
        f'y="{REPEATS * rows / 2:g}"/></transform><emitter type="area"><texture type="bitmap" name="radiance">'
        f'<string name="filename" value="{BITMAP_FILE}"/><boolean name="raw" value="true"/>'
        f'<transform name="to_uv"><scale value="{REPEATS}"/></transform></texture></emitter></shape>'
    )
