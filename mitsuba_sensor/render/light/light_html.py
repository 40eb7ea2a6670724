"""What irradiance shows in a notebook: its colours in small, and what it is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...camera.colour_matrix import colour_matrix
from ...camera.fingerprint import response_fingerprint
from ...core import Float64Array
from ...core.html import facts, fragment, picture
from ...files import png
from ...optics import spectra
from ...optics.spectra import srgb_curve
from .brightness import brightness_sentence

if TYPE_CHECKING:
    from .irradiance import Irradiance

MOST_PIXELS = 60_000
BRIGHT = 99.0  # percentile of the lit pixels that is white
VISIBLE_NM = 380.0, 780.0


def light_html(light: Irradiance) -> str:
    """A picture in the colours of the light, where it has any that are seen, and the numbers."""
    shown, how = light_picture(light)
    rows, columns, bands = light.data.shape
    names = ", ".join(light.filters or ())
    low, high = (light.wavelengths_nm + light.bandwidths_nm * side for side in (-0.5, 0.5))
    total = light.data.astype(np.float64) @ (
        np.ones(bands) if light.filters else light.bandwidths_nm
    )
    finite = total[np.isfinite(total)]
    statistics, known = light.statistics, light.rendered_for
    found = {
        "size": f"{columns} × {rows} pixels from {tuple(light.origin)} (row, column)",
        "spectrum": f"behind the filters {names}"
        if names
        else f"{bands} bands, {low.min():g} to {high.max():g} nm",
        "irradiance": f"{finite.mean():.4g} W/m² on average, at most {finite.max():.4g}"
        if finite.size
        else "infinite",
        "render": f"{statistics.samples_per_pixel} samples per pixel, {statistics.seconds:.3g} s, {statistics.variant}",
        "picture": how,
    }
    if known is not None:
        name = (
            "a camera with stages that were added"
            if known.camera is None
            else known.camera.name
        )
        found["rendered for"] = f"{name}, {known.exposure.time_s:g} s, serial {known.serial}"
    if statistics.brightness and (said := brightness_sentence(statistics.brightness)):
        found["brightness"] = said
    if statistics.notes:
        found["notes"] = " · ".join(statistics.notes)
    return fragment(
        "Irradiance at the focal plane",
        picture(png.png(shown), shown.shape[1], how),
        facts(found),
    )


def light_picture(light: Irradiance) -> tuple[NDArray[np.uint8], str]:
    """At most MOST_PIXELS pixels, 8 bit, and a text that says what they are; white is the BRIGHT percentile."""
    small = np.where(
        np.isfinite(small := _binned(light.data)), small, np.float64(np.finfo(np.float32).max)
    )
    linear, how = _colours(light, small)
    level = linear.max(axis=-1) if linear.ndim == 3 else linear
    lit = level[level > 0]
    white = float(np.percentile(lit, BRIGHT)) if lit.size else 1.0
    return np.rint(255 * srgb_curve(np.clip(linear / white, 0.0, 1.0))).astype(np.uint8), how


def _colours(light: Irradiance, data: Float64Array) -> tuple[Float64Array, str]:
    """Linear sRGB, (H, W, 3), of what is seen of the light; or the total, (H, W)."""
    known = light.rendered_for
    if light.filters is not None:
        camera = None if known is None else known.camera
        own = camera is not None and light.response in (None, response_fingerprint(camera))
        matrix = colour_matrix(camera, known.illuminant) if own and camera and known else None
        if matrix is None:
            return data.sum(axis=-1), "irradiance, sum over the filters"
        return (
            data * matrix.white_balance @ matrix.to_srgb.T,
            "colours of the scene, white balanced",
        )
    seen = (light.wavelengths_nm > VISIBLE_NM[0]) & (light.wavelengths_nm < VISIBLE_NM[1])
    if seen.sum() < 3:
        return data @ light.bandwidths_nm, "irradiance, sum over the bands"
    observer = spectra.observer(light.wavelengths_nm[seen]) * light.bandwidths_nm[seen]
    return data[
        ..., seen
    ] @ observer.T @ spectra.xyz_to_srgb().T, "colours of the light, as they are seen"


def _binned(data: NDArray[np.float32]) -> Float64Array:
    """Means of square blocks, so that no more than MOST_PIXELS are left."""
    rows, columns, bands = data.shape
    step = max(int(np.ceil((rows * columns / MOST_PIXELS) ** 0.5)), 1)
    step_y, step_x = min(step, rows), min(step, columns)
    down, right = rows // step_y, columns // step_x
    whole = data[: down * step_y, : right * step_x].reshape(down, step_y, right, step_x, bands)
    return np.asarray(whole.mean(axis=(1, 3), dtype=np.float64))
