"""From the raw values behind the colour filters of a camera to colours on a screen, under the light of the scene."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..core import Exposure, Float64Array, Frame, Photons, SensorWindow
from ..core.signals import Illuminant
from ..optics import spectra
from ..stages.stage import detector_of
from .camera import Camera

NOISE = 0.0003  # of white, of a raw value: a matrix that amplifies it much is no good for pictures with noise
STEP_NM = 5.0  # width of the bands of an illuminant
LEAST_SHARE = 1e-3  # of the mean of red, green and blue, and of power that is seen: less is no light for colours


class ColourMatrix(NamedTuple):
    """white_balance : (F,) factors, none below 1, that make a white surface equal behind the filters red, green and
    blue.  to_srgb : (3, F) from balanced values to linear sRGB, white to (1, 1, 1).  illuminant : "scene" or "D65"."""

    white_balance: Float64Array
    to_srgb: Float64Array
    illuminant: str


def colour_matrix(camera: Camera, illuminant: Illuminant | None = None) -> ColourMatrix | None:
    """Of a camera with filters red, green and blue that detect daylight; None for any other.

    illuminant : of the scene; daylight where there is none, or one of the three detects nothing of it, or an observer.

    The matrix gives the reflectances of a training set (190 surfaces of the AMPAS, from colour-science) the colours
    that an observer sees, as well as it can: the sum of the distances in CIELAB is least. Colours are adapted from the
    illuminant to daylight (CAT02). A fourth filter, for infrared for example, takes part.
    """
    parts = None if illuminant is None else tuple(tuple(np.ravel(x)) for x in illuminant)
    return _fit(camera, parts)


@lru_cache(
    maxsize=64
)  # a fit takes 20 ms, and every file of every sample of a dataset asks for it
def _fit(camera: Camera, parts: tuple[tuple[float, ...], ...] | None) -> ColourMatrix | None:
    illuminant = None if parts is None else Illuminant(*map(np.array, parts))
    order = colour_order(camera.filter_names)
    if order is None:
        return None
    name, light = "scene", illuminant
    if light is None or not _detected(camera, light, order):
        name, light = spectra.DAYLIGHT, standard_light(camera, spectra.DAYLIGHT)
        if not _detected(camera, light, order):
            return None
    electrons, middles = _electrons(camera, light), light.wavelengths_nm
    white, surfaces = (
        electrons.sum(axis=1),
        np.vstack([spectra.surfaces(middles), np.ones(middles.size)]),
    )
    balance = np.ones(white.size)
    balance[order] = white[order].max() / white[order]
    raw = (
        surfaces @ electrons.T * balance / white[order].max()
    )  # white is 1 behind red, green and blue
    return ColourMatrix(balance, _fitted(raw, _seen(surfaces, light), order[1]), name)


def colour_order(filter_names: tuple[str, ...]) -> list[int] | None:
    """Which filter is red, green, blue; None when the camera is not of that kind and its preview stays grey."""
    initials = [name[:1].lower() for name in filter_names]
    if {*"rgb"} <= {*initials}:
        return [initials.index(one) for one in "rgb"]
    return None


def _electrons(camera: Camera, light: Illuminant) -> Float64Array:
    """(F, B) electrons behind each filter of a white surface, in any unit: photons times QE."""
    middles, power = light
    return np.asarray(flat_field_qe(camera, middles) * power * middles)


def flat_field_qe(camera: Camera, wavelengths_nm: Float64Array) -> Float64Array:
    """(F, B) QE of each filter as a flat field shows it: with the photoelectrons that neighbours give and take."""
    detection = detector_of(camera.stages)
    if detection.light_reach_px == 0:
        return camera.qe(wavelengths_nm)
    shape = len(camera.tile), len(camera.tile[0])
    frame, filters = Frame(Exposure(1.0), SensorWindow(0, shape)), camera.filter_index(shape)
    found = np.empty((len(camera.filter_names), wavelengths_nm.size))
    for band, wavelength_nm in enumerate(wavelengths_nm):
        photons = Photons(np.ones((*shape, 1)), np.array([wavelength_nm]))
        collected = detection.sample(photons, frame).light
        for number in range(len(found)):
            found[number, band] = collected[filters == number].mean()
    return found


def _detected(camera: Camera, light: Illuminant, order: list[int]) -> bool:
    """Whether red, green and blue detect this light, and an observer sees it."""
    found = _electrons(camera, light).sum(axis=1)[order]
    seen = spectra.photopic(light.wavelengths_nm) @ light.power
    return bool(
        found.min() > LEAST_SHARE * found.mean() and seen > LEAST_SHARE * light.power.sum()
    )


def standard_light(camera: Camera, name: str) -> Illuminant:
    """A CIE illuminant in bands of STEP_NM, over what the camera and an observer see."""
    low_nm, high_nm = camera.band_nm
    middles = np.arange(min(low_nm, 380.0), max(high_nm, 780.0) + 1, STEP_NM)
    return Illuminant(middles, spectra.standard_illuminant(name, middles))


def _seen(reflectances: Float64Array, light: Illuminant) -> Float64Array:
    """(N, 3) XYZ under the illuminant, adapted to daylight; the Y of the last one, white, is 1."""
    found = reflectances @ (spectra.observer(light.wavelengths_nm) * light.power).T
    found /= found[-1, 1]
    return spectra.adapted_to_daylight(found, found[-1])


def _fitted(raw: Float64Array, wanted: Float64Array, last: int) -> Float64Array:
    """(3, F) from raw values to linear sRGB, of which white, the last surface, stays white.

    last : number of a filter for which white is 1; its column follows from the others.
    """
    from scipy.optimize import least_squares

    white, lab, others = (
        spectra.D65_XYZ,
        spectra.lab(wanted),
        np.arange(raw.shape[1]) != last,
    )
    off = raw[:, others] - raw[:, [last]] * raw[-1, others]

    def found(free: Float64Array) -> Float64Array:
        """XYZ over that of white."""
        return np.asarray(raw[:, [last]] + off @ free.reshape(-1, 3))

    def distances(free: Float64Array) -> Float64Array:
        off_by = (spectra.lab(white * found(free)) - lab).ravel()
        robust = off_by / np.sqrt(
            1 + np.abs(off_by)
        )  # squared: a distance, but small ones squared
        return np.append(
            robust, 100 * NOISE * len(raw) ** 0.5 * free
        )  # about L* for Y, of every surface

    start = np.linalg.lstsq(off, wanted / white - raw[:, [last]], rcond=None)[0]
    columns = np.empty((3, raw.shape[1]))
    columns[:, others] = least_squares(distances, start.ravel()).x.reshape(-1, 3).T
    columns[:, last] = 1 - columns[:, others] @ raw[-1, others]
    return np.asarray(spectra.XYZ_TO_SRGB @ (white[:, None] * columns))
