"""Light of a chart at the focal plane, rendered once for the optics of a camera and kept in the user's cache folder."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
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
from ...files.user_cache import keep, kept_file, read_kept
from ...render.light.photons import photons_per_irradiance
from ...render.passes.prepared import render
from ...render.variants import choose_variant
from .scene_text import BITMAP_FILE
from .setting import Bands

RENDERERS = "mitsuba-sensor", "mitsuba", "drjit"
"""Packages whose versions the light depends on."""
NARROW_NM = 10.0
"""Width of the band of a chart that is seen in one colour."""


class ChartScene(NamedTuple):
    """A chart as a scene.

    name : of its light.  text : the XML, or the name of a scene that ships.  samples : of each pixel.
    wavelength_nm : of its only band; None: all bands that the camera detects.
    width : columns of the picture, where they are not those of the scene.
    pixels : of the camera along each side of one of the picture.
    bitmap : radiance at the points of a bitmap, from the top, where the text has BITMAP_FILE.
    """

    name: str
    text: str
    samples: int
    wavelength_nm: float | None = None
    width: int | None = None
    pixels: float = 1.0
    bitmap: Float64Array | None = None

    def seen_by(self, camera: Camera) -> Camera:
        """The camera with the pixels of the picture."""
        if self.pixels == 1:
            return camera
        across, down = (camera.pixel.pitch_x_um, camera.pixel.pitch_y_um)
        wider = {
            "pixel.pitch_x_um": across * self.pixels,
            "pixel.pitch_y_um": down * self.pixels,
        }
        return camera.replace(**wider)


class ChartLight(NamedTuple):
    """Irradiance of a chart.

    data : (H, W, B) [W m⁻² nm⁻¹].  bands : of it.
    standard_error : (H, W, B) of the render, in the same unit.
    """

    data: Float64Array
    bands: Bands
    standard_error: Float64Array

    def photons(
        self, camera: Camera, exposure: Exposure, irradiance: Float64Array
    ) -> Float64Array:
        """Mean photons per pixel in one exposure of irradiance (…, B) in these bands."""
        return np.asarray(irradiance * photons_per_irradiance(camera, exposure, *self.bands))

    @property
    def render_noise_percent(self) -> float:
        """Root mean square of the render noise of all pixels, over the brightest light [%]."""
        widths = self.bands.bandwidths_nm
        noise = np.sqrt(np.square(self.standard_error * widths).sum(axis=-1))
        return 100 * float(np.sqrt(np.square(noise).mean()) / (self.data @ widths).max())


def light_of(scene: ChartScene, camera: Camera) -> ChartLight:
    """The light of a chart for the lens and the pixels of a camera: kept, else rendered and kept.

    Raises InputError where the renderer does.
    """
    name = _kept_name(scene, camera)
    kept = read_kept(name)
    if kept is None:
        kept = _rendered(scene, camera)
        keep(name, kept)
    bands = Bands(kept["wavelengths_nm"], kept["bandwidths_nm"])
    data, error = (kept[name].astype(np.float64) for name in ("data", "standard_error"))
    return ChartLight(data, bands, error)


def cache_file(scene: ChartScene, camera: Camera) -> Path:
    """Where the light of a chart is kept."""
    return kept_file(_kept_name(scene, camera))


def _kept_name(scene: ChartScene, camera: Camera) -> str:
    return f"chart-{scene.name}-{fingerprint(scene, camera)}"


def fingerprint(scene: ChartScene, camera: Camera) -> str:
    """A hash of all that the light depends on: the chart, the lens, the pixels, the bands, and the renderer."""
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
    """The text of a scene, with its bitmap in a file for as long as it is needed."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "bitmap.exr"
        if scene.bitmap is not None:
            write_planes(file, {}, {"Y": Plane(scene.bitmap[::-1])})  # from the bottom
        yield scene.text.replace(BITMAP_FILE, str(file))


def _rendered(scene: ChartScene, camera: Camera) -> dict[str, np.ndarray]:
    """The arrays that are kept."""
    own = {}
    if scene.wavelength_nm is not None:
        own = {"wavelength_nm": scene.wavelength_nm, "bandwidth_nm": NARROW_NM}
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
            **own,  # type: ignore[arg-type]
        )
    return {
        "data": light.data,
        "wavelengths_nm": light.wavelengths_nm,
        "bandwidths_nm": light.bandwidths_nm,
        "standard_error": light.standard_error,
    }
