"""The representation of irradiance in a notebook: a small image and its facts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core.html import facts, fragment, picture
from ...files import png
from ...optics import spectra
from .brightness import brightness_sentence

if TYPE_CHECKING:
    from .irradiance import Irradiance

PIXELS_MAX = 60_000
WHITE_PERCENTILE = 99.0  # of the lit pixels
VISIBLE_NM = 380.0, 780.0


def light_html(light: Irradiance) -> str:
    """Return an image in the colours of the light, and a table of facts."""
    shown, how = _light_picture(light)
    rows, columns, bands = light.data.shape
    low, high = (light.wavelengths_nm + light.bandwidths_nm * side for side in (-0.5, 0.5))
    statistics, known = light.statistics, light.rendered_for
    rows_of_table = {
        "size": f"{columns} × {rows} pixels from {tuple(light.origin)} (row, column)",
        "spectrum": f"{bands} bands, {low.min():g} to {high.max():g} nm",
        "render": f"{statistics.samples_per_pixel} samples per pixel, {statistics.seconds:.3g} s, {statistics.variant}",
        "picture": how,
    }
    if light.filters:
        rows_of_table["spectrum"] = f"behind the filters {', '.join(light.filters)}"
    if known is not None:
        name = "a camera with added stages" if known.camera is None else known.camera.name
        rows_of_table["rendered for"] = (
            f"{name}, {known.exposure.time_s:g} s, serial {known.serial}"
        )
    if statistics.brightness and (text := brightness_sentence(statistics.brightness)):
        rows_of_table["brightness"] = text
    if statistics.notes:
        rows_of_table["notes"] = " · ".join(statistics.notes)
    image = picture(png.png(shown), shown.shape[1], how)
    return fragment("Irradiance at the focal plane", image, facts(rows_of_table))


def _light_picture(light: Irradiance) -> tuple[NDArray[np.uint8], str]:
    """Return at most PIXELS_MAX pixels of 8 bits, and their caption: the visible colours of the light, or its sum over
    bands or filters."""
    step = max(int(np.ceil((light.data[..., 0].size / PIXELS_MAX) ** 0.5)), 1)
    largest = float(np.finfo(np.float32).max)
    small = np.nan_to_num(light.data[::step, ::step].astype(np.float64), posinf=largest)
    seen = (light.wavelengths_nm > VISIBLE_NM[0]) & (light.wavelengths_nm < VISIBLE_NM[1])
    if light.filters is None and seen.sum() >= 3:
        observer = spectra.observer(light.wavelengths_nm[seen]) * light.bandwidths_nm[seen]
        linear = small[..., seen] @ observer.T @ spectra.XYZ_TO_SRGB.T
        level, how = linear.max(axis=-1), "visible colours of the light"
    else:
        linear = level = small @ light.bandwidths_nm
        how = f"irradiance, sum over the {'bands' if light.filters is None else 'filters'}"
    lit = level[level > 0]
    white = float(np.percentile(lit, WHITE_PERCENTILE)) if lit.size else 1.0
    shown = 255 * spectra.srgb_curve(np.clip(linear / white, 0.0, 1.0))
    return np.rint(shown).astype(np.uint8), how
