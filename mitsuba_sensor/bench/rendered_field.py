"""The light of a virtual bench through the renderer: an even field in front of a telecentric lens."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..camera.camera import Camera
from ..core import Exposure
from ..optics.f_number_law import transmittance
from ..render.light.photons import collect
from ..render.passes.prepared import render

Array = NDArray[np.float64]
RADIANCE = 1e-3
"""L at all wavelengths [W m⁻² sr⁻¹ nm⁻¹]."""

SIDE, SAMPLES = 64, 64
"""Pixels of the film's side, and samples of each: render noise of the mean is 2e-4 where one sample has 0.1."""


class Field(NamedTuple):
    """Photons that arrive in each band over all photons that the laboratory believes to arrive, (B,).

    wavelengths_nm : centres of the bands, (B,).  efficiency : QE of each colour filter for this light, (F,).
    """

    shares: Array
    wavelengths_nm: Array
    efficiency: Array


def field_at(camera: Camera, wavelength_nm: float) -> Field:
    """Exact light of one wavelength."""
    return Field(np.ones(1), np.array([wavelength_nm]), camera.qe([wavelength_nm])[:, 0])


def rendered_field(camera: Camera) -> Field:
    """A radiance L of a flat spectrum, rendered, over the photons of E = πLT/(4N²), which a laboratory computes.

    The mean over a small film stands for the sensor: the light is even, and each pixel has its render noise.
    """
    film = {"type": "specfilm", "width": SIDE, "height": SIDE, "rfilter": {"type": "box"}}
    scene = {
        "type": "scene",
        "integrator": {"type": "path"},
        "sensor": {"type": "orthographic", "film": film, "sampler": {"type": "multijitter"}},
        "emitter": {"type": "constant", "radiance": {"type": "uniform", "value": RADIANCE}},
    }
    second = Exposure(1.0)
    photons = collect(render(scene, camera, second, spp=SAMPLES, denoise=False), camera, second)
    mean, centres = (
        np.asarray(photons.mean, np.float64).mean(axis=(0, 1)),
        np.asarray(photons.wavelengths_nm),
    )
    even = math.pi * RADIANCE * transmittance(camera, centres) / (4 * camera.lens.f_number**2)
    widths = photons.bandwidths_nm
    known = collect(
        even[None, None], camera, second, wavelengths_nm=centres, bandwidths_nm=widths
    ).total[0, 0]
    return Field(mean / known, centres, camera.qe(centres, widths) @ (mean / mean.sum()))
