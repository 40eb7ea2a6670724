"""The film that is put into every scene: one channel per wavelength band, one box filter per pixel, float32."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

DENSITY_STEPS = 64  # see mend_wavelength_sampling


def response_film(mi: Any, responses: Sequence[Mapping[str, Any]], size: Mapping[str, int]) -> Any:
    """A specfilm with one channel ∫ response·L dλ for each response (a Mitsuba spectrum), safe to sample."""
    channels = {f"band{k:04d}": dict(response) for k, response in enumerate(responses)}  # kept in order of their names
    film = mi.load_dict(
        {"type": "specfilm", "component_format": "float32", "rfilter": {"type": "box"}, **size, **channels}
    )
    mend_wavelength_sampling(mi, film)
    return film


def focus_wavelengths(mi: Any, film: Any, low_nm: float, high_nm: float) -> None:
    """Draw wavelengths evenly between two edges of bands, and none elsewhere; no kernel is compiled for it.

    The density is linear between its nodes, so a sixteenth of a band on either side gets a few: they are lost.
    """
    parameters = mi.traverse(film.sensor_response_function())
    first, last = (float(x) for x in parameters["range"])
    nodes = np.linspace(first, last, len(parameters["values"]))
    step = (last - first) / (len(nodes) - 1)
    inside = (nodes > low_nm - 0.25 * step) & (nodes < high_nm + 0.25 * step)
    parameters["values"] = type(parameters["values"])(inside.astype(float).tolist())
    parameters.update()


def mend_wavelength_sampling(mi: Any, film: Any) -> None:
    """Make the density from which the film draws wavelengths safe to sample.

    Mitsuba 3.9.1 inverts the density in float32 with a formula that cancels where neighbouring nodes are nearly, but
    not exactly, equal: adjacent bands of height 1 ± 3e-7 come out 1 … 2 instead of 1, without visible noise. Rounded
    to 64 steps, neighbours are equal or clearly different. It stays unbiased: the film divides by the same density.
    """
    parameters = mi.traverse(film.sensor_response_function())
    values = np.array(parameters["values"], dtype=float)
    steps = np.maximum(np.round(values / values.max() * DENSITY_STEPS), 1)
    parameters["values"] = type(parameters["values"])(steps.tolist())
    parameters.update()
