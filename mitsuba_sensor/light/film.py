"""The film that is put into every scene: one channel per wavelength band, one box filter per pixel, float32."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

DENSITY_STEPS = 64  # see mend_wavelength_sampling


def band_film(mi: Any, edges_nm: NDArray[np.float64], size: Mapping[str, int]) -> Any:
    """A film whose channels are boxes of height 1 between adjacent edges: ∫L dλ over each band.

    edges_nm : (B + 1,) ascending.  size : width, height and crop_* of the film.
    A box is a ``regular`` spectrum: an ``irregular`` one costs a search for every sample and band (a 30-band film was
    1.5 to 1.7 times slower with it), and ``uniform`` cannot be a response.
    """
    edges = edges_nm.tolist()
    boxes = [
        {"type": "regular", "wavelength_min": low, "wavelength_max": high, "values": "1, 1"}
        for low, high in zip(edges[:-1], edges[1:], strict=True)
    ]
    return response_film(mi, boxes, size)


def response_film(mi: Any, responses: Sequence[Mapping[str, Any]], size: Mapping[str, int]) -> Any:
    """A specfilm with one channel ∫ response·L dλ for each response (a Mitsuba spectrum), safe to sample."""
    channels = {f"band{k:04d}": dict(response) for k, response in enumerate(responses)}  # kept in order of their names
    film = mi.load_dict(
        {"type": "specfilm", "component_format": "float32", "rfilter": {"type": "box"}, **size, **channels}
    )
    mend_wavelength_sampling(mi, film)
    return film


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
