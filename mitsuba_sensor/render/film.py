"""The film of every render: one channel per spectral response, one box filter per pixel, float32."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..core.types import Float64Array
from .variants import MitsubaObject, mitsuba

DENSITY_STEPS = 64  # see round_wavelength_density


def response_film(responses: Sequence[Mapping[str, object]], size: Mapping[str, int | str]) -> MitsubaObject:
    """A specfilm with one channel ∫ response·L dλ for each response (a Mitsuba spectrum)."""
    channels = {f"band{k:04d}": dict(response) for k, response in enumerate(responses)}  # kept in order of their names
    film = mitsuba().load_dict(
        {"type": "specfilm", "component_format": "float32", "rfilter": {"type": "box"}, **size, **channels}
    )
    round_wavelength_density(film)
    return film


def restrict_wavelengths(film: MitsubaObject, low_nm: float, high_nm: float) -> None:
    """Sample wavelengths uniformly between two edges of bands, and none elsewhere, without compiling a kernel.

    The density is linear between its nodes, so a few samples fall into a sixteenth of a band on either side: they are
    lost.
    """
    parameters = mitsuba().traverse(film.sensor_response_function())
    first, last = (float(x) for x in parameters["range"])
    nodes = np.linspace(first, last, len(parameters["values"]))
    step = (last - first) / (len(nodes) - 1)
    _set_density(parameters, ((nodes > low_nm - 0.25 * step) & (nodes < high_nm + 0.25 * step)).astype(float))


def round_wavelength_density(film: MitsubaObject) -> None:
    """Round the density from which the film samples wavelengths, so that its inversion in float32 is accurate.

    Mitsuba 3.9.1 inverts the density in float32 with a formula that cancels where neighbouring nodes are nearly, but
    not exactly, equal: adjacent bands of height 1 ± 3e-7 come out 1 … 2 instead of 1, without visible noise. Rounded
    to 64 steps, neighbours are equal or clearly different. It stays unbiased: the film divides by the same density.
    """
    parameters = mitsuba().traverse(film.sensor_response_function())
    values = np.array(parameters["values"], dtype=float)
    _set_density(parameters, np.maximum(np.round(values / values.max() * DENSITY_STEPS), 1))


def _set_density(parameters: MitsubaObject, values: Float64Array) -> None:
    parameters["values"] = type(parameters["values"])(values.tolist())
    parameters.update()
