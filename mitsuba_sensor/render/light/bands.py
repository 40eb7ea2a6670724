"""The spectral channels of a render (adjacent bands, one band or colour filters), and the film that measures them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...camera.camera import Camera
from ...camera.fingerprint import pixel_fingerprint, response_fingerprint
from ...core import Array, Float64Array, InputError, require
from ...core.llvm import drjit
from ...optics.f_number_law import transmittance
from ..samples import LONGEST_NM, NARROWEST_NM, SHORTEST_NM
from ..variants import MitsubaObject, mitsuba

BANDWIDTH_NM = 10.0  # default width of a band
GROUP = 4  # wavelengths that Mitsuba samples for one path
NODES = 17  # of a box in a cube; the density of wavelengths has the same nodes
STEPS_NM = (1.0, 0.5, 0.25, 0.2, 0.1, 0.05)
"""Steps of tabulated responses, linear in between: the first step that meets all kinks is taken."""
DENSITY_STEPS = 64  # see round_wavelength_density
SMALLEST = 1e-30  # replaces 0
SPECTRAL = ("auto", "cube", "channels")
FACTORS = (0.0, 1e3)
"""Limits of the electrons of a band over those of a flat spectrum; values outside are rounding errors."""

BandKind = Literal["cube", "single", "channels"]


@dataclass(frozen=True, eq=False)
class Bands:
    """The channels of one film.

    kind : "cube" or "single", boxes of height 1, to be multiplied by the lens's transmission; or "channels", one
        response T(λ)·QE(λ)·λ/λ_ref per colour filter, so ∫E dλ of a channel at λ_ref gives the photoelectrons.
    edges_nm : edges of the boxes, shape (B + 1,); for channels the two ends of the camera's band.
    wavelengths_nm, bandwidths_nm : centres and widths, shape (B,); λ_ref and 1 nm for every channel.
    responses : Mitsuba spectra of the B channels of the film, followed by the responses of ``filters`` colour filters
        for every group of bands, like those of kind "channels".
    transmission : of the lens, shape (B,), still to be applied; 1 if it is part of the responses.
    response : None, or the fingerprint of the camera whose filters are in the responses.
    grouped : True if bands are rendered in groups of four, with less noise in each band and more in their sum.
    light_scale : factor on all emitters.
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
        """λ_ref of the colour filters [nm]: the middle of all bands."""
        return float(self.edges_nm[0] + self.edges_nm[-1]) / 2

    @property
    def scale(self) -> Float64Array:
        """Irradiance over the value in the film, shape (B + filters,): T/Δλ of a band, 1 of a filter, times
        ``light_scale``."""
        scale = np.append(self.transmission / self.bandwidths_nm, np.ones(self.filters))
        return np.asarray(self.light_scale * scale)

    @property
    def groups(self) -> tuple[slice, ...]:
        """The channels that share light paths: four bands at a time if ``grouped``, else all.

        Mitsuba samples four equidistant wavelengths per path. With four equal bands each band gets exactly one
        wavelength; with thirty bands most get none, which adds noise to each band but not to the sum that a frame
        measures.
        """
        if not self.grouped or len(self) <= GROUP:
            return (slice(0, len(self)),)
        return tuple(slice(k, min(k + GROUP, len(self))) for k in range(0, len(self), GROUP))

    @property
    def first_filter(self) -> int:
        """Index of the first channel of the film that is a colour filter."""
        return 0 if self.kind == "channels" else len(self)

    @property
    def ends_nm(self) -> tuple[float, float]:
        """Ends of the range of all channels [nm]."""
        return float(self.edges_nm[0]), float(self.edges_nm[-1])

    def ends_of(self, group: slice) -> tuple[float, float]:
        """Return the ends of the range of a group of bands [nm]."""
        return float(self.edges_nm[group.start]), float(self.edges_nm[group.stop])

    def __len__(self) -> int:
        return len(self.wavelengths_nm)


def choose_bands(
    camera: Camera, wavelength_nm: float | None, bandwidth_nm: float, spectral: str
) -> Bands:
    """Return the channels for a render of this camera. Raises InputError.

    wavelength_nm : centre of a single band.
    spectral : "auto", adjacent bands of ``bandwidth_nm`` over the camera's band (the last may be narrower), with least
        noise in this camera's frame; "cube", the same bands with least noise in each; "channels", its colour filters.
    """
    if spectral not in SPECTRAL:
        raise InputError(f"spectral is {spectral!r}; it must be one of {', '.join(SPECTRAL)}.")
    if spectral == "channels":
        if wavelength_nm is not None:
            raise InputError(
                "spectral is 'channels' and wavelength_nm is given, but a single band has no colour filters; remove "
                "one of the two."
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
    """Return adjacent boxes of height 1 between the edges, shape (B + 1,): ∫L dλ over each, or ∫T·L dλ if the lens has
    a transmission curve.

    A box is a ``regular`` spectrum: ``irregular`` needs a search for every sample and band (a film of 30 bands was 1.5
    to 1.7 times slower), and ``uniform`` cannot be a response.
    """
    edges, centres = edges_nm.tolist(), (edges_nm[:-1] + edges_nm[1:]) / 2
    kind: BandKind = "cube" if len(centres) > 1 else "single"
    boxes, transmission = list[dict[str, object]](), transmittance(camera, centres)
    if camera.lens.transmission_curve is not None:
        transmission = np.ones(len(centres))
    for low, high in pairwise(edges):
        is_whole = high - low > 0.999 * max(edges[1] - edges[0], 1e-9)
        values = [1.0] * (NODES if len(edges) > GROUP + 1 and is_whole else 2)
        if camera.lens.transmission_curve is not None:
            values = transmittance(camera, _nodes(camera, low, high)).tolist()
        boxes.append(_regular(low, high, values))
    return Bands(kind, edges_nm, centres, np.diff(edges_nm), tuple(boxes), transmission)


def channel_bands(camera: Camera) -> Bands:
    """Return one response T(λ)·QE(λ)·λ/λ_ref for the pixels behind each colour filter (paper eqs. 12 and 14)."""
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
    """Return T(λ)·QE(λ)·λ/λ_ref of every filter between two wavelengths, 0 outside."""
    nodes = _nodes(camera, low_nm, high_nm)
    curves = (
        np.atleast_2d(camera.qe(nodes)) * transmittance(camera, nodes) * nodes / reference_nm
    )
    return tuple(_regular(low_nm, high_nm, curve.tolist()) for curve in curves)


def _nodes(camera: Camera, low_nm: float, high_nm: float) -> Float64Array:
    """Return equidistant wavelengths that include the points of the camera's curves, if these lie on a grid of
    0.05 nm."""
    lens_nm = camera.lens.transmission_wavelengths_nm or ()
    points = np.array([*camera.quantum_efficiency.wavelengths_nm, *lens_nm])
    kinks = np.append(points[(points > low_nm) & (points < high_nm)], high_nm) - low_nm
    met = (
        step
        for step in STEPS_NM
        if np.allclose(kinks / step, np.round(kinks / step), atol=1e-6)
    )
    count = max(math.ceil((high_nm - low_nm) / next(met, STEPS_NM[-1]) - 1e-6), 1)
    return np.linspace(low_nm, high_nm, count + 1)


def _regular(low_nm: float, high_nm: float, values: list[float]) -> dict[str, object]:
    """Return a Mitsuba spectrum of equidistant nodes; Mitsuba rejects a spectrum that is 0 everywhere."""
    text = ", ".join(repr(float(v) if any(values) else SMALLEST) for v in values)
    ends = {"wavelength_min": low_nm, "wavelength_max": high_nm}
    return {"type": "regular", **ends, "values": text}


def response_film(
    responses: Sequence[Mapping[str, object]], size: Mapping[str, int | str]
) -> MitsubaObject:
    """Return a specfilm with one channel ∫ response·L dλ for each response (a Mitsuba spectrum)."""
    kind = {"type": "specfilm", "component_format": "float32", "rfilter": {"type": "box"}}
    # The film sorts its channels by name.
    channels = {f"band{k:04d}": film_response(x) for k, x in enumerate(responses)}
    film = mitsuba().load_dict({**kind, **size, **channels})
    round_wavelength_density(film)
    return film


def restrict_wavelengths(film: MitsubaObject, low_nm: float, high_nm: float) -> None:
    """Sample wavelengths uniformly between two edges of bands only, without compiling a kernel. The density is linear
    between its nodes, so a few samples fall into a sixteenth of a band on either side, and are lost."""
    parameters = mitsuba().traverse(film.sensor_response_function())
    first, last = (float(x) for x in parameters["range"])
    nodes = np.linspace(first, last, len(parameters["values"]))
    margin = 0.25 * (last - first) / (len(nodes) - 1)
    inside = (nodes > low_nm - margin) & (nodes < high_nm + margin)
    _set_density(parameters, inside.astype(float))


def round_wavelength_density(film: MitsubaObject) -> None:
    """Round the density from which the film samples wavelengths, so its inversion in float32 is accurate.

    Mitsuba 3.9.1 inverts the density in float32 with a formula that cancels if neighbouring nodes are nearly, but not
    exactly, equal: adjacent bands of height 1 ± 3e-7 come out between 1 and 2 instead of 1, without visible noise.
    Rounded to 64 steps, neighbours are equal or clearly different. The film divides by the same density, so the result
    stays unbiased.
    """
    parameters = mitsuba().traverse(film.sensor_response_function())
    values = np.array(parameters["values"], dtype=float)
    _set_density(parameters, np.maximum(np.round(values / values.max() * DENSITY_STEPS), 1))


def _set_density(parameters: MitsubaObject, values: Float64Array) -> None:
    parameters["values"] = type(parameters["values"])(values.tolist())
    parameters.update()


def film_response(response: Mapping[str, object]) -> MitsubaObject:
    """Return a Mitsuba spectrum as a response of a film; in compiled variants a flat spectrum becomes a comparison."""
    mi = mitsuba()
    spectrum = mi.load_dict(dict(response))
    is_flat = response["type"] == "regular" and len({*str(response["values"]).split(", ")}) == 1
    if mi.variant().startswith("scalar") or not is_flat:
        return spectrum
    return _flat_class(mi.variant())(spectrum)


@cache
def _flat_class(variant: str) -> MitsubaObject:
    """Return the class of flat spectra; Mitsuba has another base class in every variant."""
    mi, dr = mitsuba(), drjit()
    assert mi.variant() == variant
    base: MitsubaObject = mi.Texture

    class FlatResponse(base):  # type: ignore[misc]
        """table : the same response as one of Mitsuba's spectra."""

        def __init__(self, table: MitsubaObject) -> None:
            super().__init__(mi.Properties())
            self.table, self.height = table, float(table.max())
            self.ends_nm = [float(nm) for nm in table.wavelength_range()]

        def eval(self, si: MitsubaObject, active: Array = True) -> Array:
            """Return the height between the ends, both included, and 0 elsewhere, as the table does."""
            low_nm, high_nm = self.ends_nm
            inside = (si.wavelengths >= low_nm) & (si.wavelengths <= high_nm) & active
            return dr.select(inside, mi.UnpolarizedSpectrum(self.height), 0.0)

        def wavelength_range(self) -> MitsubaObject:
            """Return the ends [nm]."""
            return self.table.wavelength_range()

        def spectral_resolution(self) -> float:
            """Return the distance of the nodes of the table [nm], which the density of the film shares."""
            return float(self.table.spectral_resolution())

        def mean(self) -> Array:
            """Return the height."""
            return mi.Float(self.height)

        def max(self) -> float:
            """Return the height."""
            return self.height

        def traverse(self, callback: MitsubaObject) -> None:
            """Do nothing: there are no parameters."""

        def to_string(self) -> str:
            """Return a description."""
            return f"FlatResponse[{self.table}]"

    return FlatResponse


def of_own_filter(
    per_filter: NDArray[np.floating], tile: NDArray[np.integer], origin: tuple[int, int]
) -> Float64Array:
    """Return the values of each pixel's own filter, shape (H, W).

    per_filter : values of each filter, shape (H, W, F), or (H, W, 1) if all filters share them.
    tile : filter indices that repeat over the sensor.  origin : (row, column) of the first pixel on the sensor.
    """
    if per_filter.shape[2] == 1:
        return np.asarray(per_filter[..., 0], np.float64)
    values = np.empty(per_filter.shape[:2])
    for place in np.ndindex(tile.shape):
        pixels = tuple(
            slice((k - first) % period, None, period)
            for k, first, period in zip(place, origin, tile.shape, strict=True)
        )
        values[pixels] = per_filter[..., tile[place]][pixels]
    return values


def in_band_factor(
    electrons: NDArray[np.floating], bands: NDArray[np.floating]
) -> NDArray[np.float32]:
    """Return the photoelectrons over those of bands with flat spectra, shape (H, W); 1 if that is not finite."""
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = electrons / bands
    return np.where(np.isfinite(factor), np.clip(factor, *FACTORS), 1.0).astype(np.float32)


def with_filters(bands: Bands, camera: Camera) -> Bands:
    """Return the bands with the responses of the camera's filters in each group of bands."""
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
