"""Bands and film: a render's spectral channels (adjacent bands, one band or colour filters), one film channel each."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from ...camera.camera import Camera
from ...camera.fingerprint import pixel_fingerprint, response_fingerprint
from ...core import Array, Float64Array, InputError, require
from ...core.llvm import drjit
from ...optics.f_number_law import transmittance
from ..samples import LONGEST_NM, NARROWEST_NM, SHORTEST_NM
from ..variants import MitsubaObject, mitsuba

if TYPE_CHECKING:
    pass

BANDWIDTH_NM = 10.0  # of each band, unless asked otherwise
GROUP = 4  # wavelengths that Mitsuba samples for one path
NODES = 17  # of a box in a cube; the density of wavelengths has the same nodes
STEPS_NM = (
    1.0,
    0.5,
    0.25,
    0.2,
    0.1,
    0.05,
)  # of tabulated responses, linear in between: the first that meets all kinks
DENSITY_STEPS = 64  # see round_wavelength_density
NOTHING = 1e-30  # in place of 0
SPECTRAL = ("auto", "cube", "channels")
FACTORS = (0.0, 1e3)
"""A band frees at most so many times the electrons of a flat spectrum; beyond it is rounding."""

BandKind = Literal["cube", "single", "channels"]


@dataclass(frozen=True, eq=False)
class Bands:
    """The channels of one film.

    kind : "cube" or "single", boxes of height 1, with the lens's transmission still to be applied; or "channels", one
        response T(λ)·QE(λ)·λ/λ_ref per colour filter, so that ∫E dλ of a channel at λ_ref gives the photoelectrons.
    edges_nm : (B + 1,) of the boxes; for channels the two ends of the camera's band.
    wavelengths_nm, bandwidths_nm : (B,) centres and widths; λ_ref and 1 nm for every channel.
    responses : of the channels of the film, Mitsuba spectra: (B,), and behind them of ``filters`` colour filters for
        every group of bands, like those of kind "channels" below.
    transmission : (B,) of the lens, still to be applied; 1 where it is part of the responses.
    response : None, or the fingerprint of the camera whose filters are in the responses.
    grouped : whether bands are rendered in groups of four: less noise in each band, more in their sum.
    light_scale : what all emitters are multiplied by.
    """

    kind: BandKind
    edges_nm: Float64Array
    wavelengths_nm: Float64Array
    bandwidths_nm: Float64Array
    responses: tuple[Mapping[str, object], ...]
    transmission: Float64Array
    response: str | None = None
    grouped: bool = False
    filters: int = 0
    light_scale: float = 1.0

    @property
    def reference_nm(self) -> float:
        """λ_ref of the colour filters: the middle of all bands."""
        return float(self.edges_nm[0] + self.edges_nm[-1]) / 2

    @property
    def scale(self) -> Float64Array:
        """Irradiance over what the film has, (B + filters,): T/Δλ of a band, 1 of a filter, times ``light_scale``."""
        scale = np.append(self.transmission / self.bandwidths_nm, np.ones(self.filters))
        return np.asarray(self.light_scale * scale)

    @property
    def groups(self) -> tuple[slice, ...]:
        """The channels that share light paths: four bands at a time where they are ``grouped``, else all.

        Mitsuba samples four equidistant wavelengths per path: of four equal bands each gets exactly one, of thirty most
        get none. That is noise of each band, but less noise of the sum over all, which a frame of this camera measures.
        """
        if not self.grouped or len(self) <= GROUP:
            return (slice(0, len(self)),)
        return tuple(slice(k, min(k + GROUP, len(self))) for k in range(0, len(self), GROUP))

    @property
    def first_filter(self) -> int:
        """Number of the first channel of the film that is a colour filter."""
        return 0 if self.kind == "channels" else len(self)

    @property
    def ends_nm(self) -> tuple[float, float]:
        """Where the first channel begins, and where the last one ends."""
        return float(self.edges_nm[0]), float(self.edges_nm[-1])

    def ends_of(self, group: slice) -> tuple[float, float]:
        """Where the first band of a group begins, and where its last one ends."""
        return float(self.edges_nm[group.start]), float(self.edges_nm[group.stop])

    def __len__(self) -> int:
        return len(self.wavelengths_nm)


def choose_bands(
    camera: Camera, wavelength_nm: float | None, bandwidth_nm: float, spectral: str
) -> Bands:
    """The channels for a render of this camera. Raises InputError.

    wavelength_nm : centre of a single band.
    spectral : "auto", adjacent bands of ``bandwidth_nm`` over the camera's band (the last one may be narrower), least
        noise in this camera's frame; "cube", the same bands, least noise in each; "channels", its colour filters.
    """
    if spectral not in SPECTRAL:
        raise InputError(f"spectral is {spectral!r}; it must be one of {', '.join(SPECTRAL)}.")
    if spectral == "channels":
        if wavelength_nm is not None:
            raise InputError(
                "spectral is 'channels' and wavelength_nm is given; a single band has no colour filters: "
                "leave one of them out."
            )
        return channel_bands(camera)
    width = require(
        "bandwidth_nm",
        bandwidth_nm,
        NARROWEST_NM,
        LONGEST_NM - SHORTEST_NM,
        "nanometres, e.g. 10",
    )
    if wavelength_nm is not None:
        centre = require(
            "wavelength_nm", wavelength_nm, SHORTEST_NM, LONGEST_NM, "nanometres, e.g. 550"
        )
        return box_bands(camera, np.array([centre - width / 2, centre + width / 2]))
    low, high = (float(v) for v in camera.band_nm)
    count = max(math.ceil((high - low) / width - 1e-9), 1)
    bands = box_bands(camera, np.append(low + width * np.arange(count), high))
    return replace(bands, grouped=spectral == "cube" and bands.kind == "cube")


def box_bands(camera: Camera, edges_nm: Float64Array) -> Bands:
    """Adjacent boxes of height 1 between the edges, (B + 1,): ∫L dλ over each; ∫T·L dλ behind a coloured lens.

    A box is a ``regular`` spectrum: an ``irregular`` one needs a search for every sample and band (a 30-band film was
    1.5 to 1.7 times slower with it), and ``uniform`` cannot be a response.
    """
    edges = edges_nm.tolist()
    width = max(edges[1] - edges[0], 1e-9)
    centres = (edges_nm[:-1] + edges_nm[1:]) / 2
    kind: BandKind = "cube" if len(centres) > 1 else "single"
    if camera.lens.transmission_curve is not None:
        lens = tuple(_lens_response(camera, low, high) for low, high in pairwise(edges))
        return Bands(kind, edges_nm, centres, np.diff(edges_nm), lens, np.ones(len(centres)))
    boxes = tuple(
        _regular(
            low,
            high,
            [1.0] * (NODES if len(edges) > GROUP + 1 and high - low > 0.999 * width else 2),
        )
        for low, high in pairwise(edges)
    )
    return Bands(
        kind, edges_nm, centres, np.diff(edges_nm), boxes, transmittance(camera, centres)
    )


def channel_bands(camera: Camera) -> Bands:
    """One response per colour filter, T(λ)·QE(λ)·λ/λ_ref, of the pixels behind it (paper eq. 12 and 14)."""
    if camera.quantum_efficiency.quantum_yield is not None:
        raise InputError(
            "spectral is 'channels' and the camera has a quantum_yield, which needs bands; take 'cube'."
        )
    low, high = (float(v) for v in camera.band_nm)
    reference_nm = (low + high) / 2
    responses = filter_responses(camera, low, high, reference_nm)
    ones = np.ones(len(responses))
    fingerprint, ends = response_fingerprint(camera), np.array([low, high])
    return Bands("channels", ends, reference_nm * ones, ones, responses, ones, fingerprint)


def filter_responses(
    camera: Camera, low_nm: float, high_nm: float, reference_nm: float
) -> tuple[dict[str, object], ...]:
    """T(λ)·QE(λ)·λ/λ_ref of every filter from one wavelength to another, 0 beyond them."""
    nodes = _nodes(camera, low_nm, high_nm)
    curves = (
        np.atleast_2d(camera.qe(nodes)) * transmittance(camera, nodes) * nodes / reference_nm
    )
    return tuple(_regular(low_nm, high_nm, curve.tolist()) for curve in curves)


def _lens_response(camera: Camera, low_nm: float, high_nm: float) -> dict[str, object]:
    """T(λ) from one wavelength to another, 0 beyond them."""
    nodes = _nodes(camera, low_nm, high_nm)
    return _regular(low_nm, high_nm, transmittance(camera, nodes).tolist())


def _nodes(camera: Camera, low_nm: float, high_nm: float) -> Float64Array:
    """Equidistant wavelengths, among them the points of the camera's curves where these are on a grid of 0.05 nm."""
    points = np.array(
        [
            *camera.quantum_efficiency.wavelengths_nm,
            *(camera.lens.transmission_wavelengths_nm or ()),
        ]
    )
    kinks = np.append(points[(points > low_nm) & (points < high_nm)], high_nm) - low_nm
    met = (
        step
        for step in STEPS_NM
        if np.allclose(kinks / step, np.round(kinks / step), atol=1e-6)
    )
    return np.linspace(
        low_nm,
        high_nm,
        max(math.ceil((high_nm - low_nm) / next(met, STEPS_NM[-1]) - 1e-6), 1) + 1,
    )


def _regular(low_nm: float, high_nm: float, values: list[float]) -> dict[str, object]:
    """A Mitsuba spectrum of equidistant nodes; Mitsuba refuses one that is 0 everywhere."""
    text = ", ".join(
        repr(float(v)) for v in (values if any(values) else [NOTHING] * len(values))
    )
    return {
        "type": "regular",
        "wavelength_min": low_nm,
        "wavelength_max": high_nm,
        "values": text,
    }


def response_film(
    responses: Sequence[Mapping[str, object]], size: Mapping[str, int | str]
) -> MitsubaObject:
    """A specfilm with one channel ∫ response·L dλ for each response (a Mitsuba spectrum)."""
    channels = {
        f"band{k:04d}": film_response(response) for k, response in enumerate(responses)
    }  # in order of names
    film = mitsuba().load_dict(
        {
            "type": "specfilm",
            "component_format": "float32",
            "rfilter": {"type": "box"},
            **size,
            **channels,
        }
    )
    round_wavelength_density(film)
    return film


def restrict_wavelengths(film: MitsubaObject, low_nm: float, high_nm: float) -> None:
    """Sample wavelengths only, and uniformly, between two edges of bands, without compiling a kernel. The density is
    linear between its nodes: a few samples fall into a sixteenth of a band on either side, and are lost."""
    parameters = mitsuba().traverse(film.sensor_response_function())
    first, last = (float(x) for x in parameters["range"])
    nodes = np.linspace(first, last, len(parameters["values"]))
    step = (last - first) / (len(nodes) - 1)
    _set_density(
        parameters,
        ((nodes > low_nm - 0.25 * step) & (nodes < high_nm + 0.25 * step)).astype(float),
    )


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


def film_response(response: Mapping[str, object]) -> MitsubaObject:
    """A Mitsuba spectrum, as a response for a film: a flat one is compared with its ends, where code is compiled."""
    mi, flat = (
        mitsuba(),
        response["type"] == "regular" and len(set(str(response["values"]).split(", "))) == 1,
    )
    spectrum = mi.load_dict(dict(response))
    return (
        _flat_class(mi.variant())(spectrum)
        if flat and not mi.variant().startswith("scalar")
        else spectrum
    )


@cache
def _flat_class(variant: str) -> MitsubaObject:
    """The spectrum's class; Mitsuba has another base class in every variant."""
    mi, dr = mitsuba(), drjit()
    assert mi.variant() == variant
    base: MitsubaObject = mi.Texture

    class FlatResponse(base):  # type: ignore[misc]
        """table : the same as one of Mitsuba's spectra."""

        def __init__(self, table: MitsubaObject) -> None:
            super().__init__(mi.Properties())
            self.table = table
            self.ends_nm, self.height = (
                [float(nm) for nm in table.wavelength_range()],
                float(table.max()),
            )

        def eval(self, si: MitsubaObject, active: Array = True) -> Array:
            """Its height from one end to the other, both included, 0 elsewhere: as the table has it."""
            low_nm, high_nm = self.ends_nm
            inside = (si.wavelengths >= low_nm) & (si.wavelengths <= high_nm) & active
            return dr.select(inside, mi.UnpolarizedSpectrum(self.height), 0.0)

        def wavelength_range(self) -> MitsubaObject:
            """Where it begins and ends [nm]."""
            return self.table.wavelength_range()

        def spectral_resolution(self) -> float:
            """Distance of the nodes of the table [nm], from which the film takes those of its density."""
            return float(self.table.spectral_resolution())

        def mean(self) -> Array:
            """Its height."""
            return mi.Float(self.height)

        def max(self) -> float:
            """Its height."""
            return self.height

        def traverse(self, callback: MitsubaObject) -> None:
            """It has no parameters."""

        def to_string(self) -> str:
            """For people."""
            return f"FlatResponse[{self.table}]"

    return FlatResponse


def of_own_filter(
    per_filter: NDArray[np.floating], tile: NDArray[np.integer], origin: tuple[int, int]
) -> Float64Array:
    """(H, W, F), or (H, W, 1) for all filters, as each pixel's own filter has it, (H, W).

    tile : filter numbers that repeat over the sensor.  origin : (row, column) of the first pixel on it.
    """
    if per_filter.shape[2] == 1:
        return np.asarray(per_filter[..., 0], np.float64)
    found, (down, right) = np.empty(per_filter.shape[:2]), tile.shape
    for row, column in np.ndindex(tile.shape):
        here = (
            slice((row - origin[0]) % down, None, down),
            slice((column - origin[1]) % right, None, right),
        )
        found[here] = per_filter[*here, tile[row, column]]
    return found


def in_band_factor(
    electrons: NDArray[np.floating], bands: NDArray[np.floating]
) -> NDArray[np.float32]:
    """Photoelectrons over those of the bands with a flat spectrum in each, (H, W); 1 where that is no number."""
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = electrons / bands
    return np.where(np.isfinite(factor), np.clip(factor, *FACTORS), 1.0).astype(np.float32)


def with_filters(bands: Bands, camera: Camera) -> Bands:
    """The bands, and the responses of the camera's filters in each group of bands that is rendered for itself."""
    if bands.kind == "channels":
        return bands
    curves = [
        r
        for g in bands.groups
        for r in filter_responses(camera, *bands.ends_of(g), bands.reference_nm)
    ]
    count = len(camera.quantum_efficiency.curves)
    return replace(
        bands,
        responses=(*bands.responses, *curves),
        filters=count,
        response=pixel_fingerprint(camera),
    )
