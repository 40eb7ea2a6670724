"""Matrix from the raw values of a camera to colours on a screen, for the illuminant of the scene."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..core import Exposure, Float64Array, Frame, Photons, SensorWindow
from ..core.signals import Illuminant
from ..optics import spectra
from ..stages.stage import detector_of
from .camera import Camera

RAW_NOISE = 0.0003  # of white; penalises matrices that amplify noise
STEP_NM = 5.0  # width of the bands of an illuminant
LIGHT_FRACTION_MIN = 1e-3  # of the mean of red, green and blue, and of visible power


class ColourMatrix(NamedTuple):
    """White balance and colour matrix of a camera.

    white_balance : (F,) factors of at least 1 that equalise red, green and blue on a white surface.
    to_srgb : (3, F) from balanced values to linear sRGB; white becomes (1, 1, 1).
    illuminant : "scene" or "D65".
    """

    white_balance: Float64Array
    to_srgb: Float64Array
    illuminant: str


def colour_matrix(camera: Camera, illuminant: Illuminant | None = None) -> ColourMatrix | None:
    """Return the matrix of a camera with red, green and blue filters that detect daylight, else None.

    illuminant : of the scene; daylight replaces it if a filter or the observer cannot see it.

    The matrix minimises the sum of CIELAB distances between the camera's and an observer's colours of a training set
    (190 surfaces of the AMPAS, from colour-science). Colours are adapted from the illuminant to daylight (CAT02). A
    fourth filter, e.g. infrared, also contributes.
    """
    spectrum = None if illuminant is None else tuple(tuple(np.ravel(x)) for x in illuminant)
    return _fit(camera, spectrum)


@lru_cache(maxsize=64)  # a fit takes 20 ms and is needed for every file of a dataset
def _fit(camera: Camera, spectrum: tuple[tuple[float, ...], ...] | None) -> ColourMatrix | None:
    order = colour_order(camera.filter_names)
    if order is None:
        return None
    name, light = "scene", None if spectrum is None else Illuminant(*map(np.array, spectrum))
    if light is None or not _detected(camera, light, order):
        name, light = spectra.DAYLIGHT, standard_light(camera, spectra.DAYLIGHT)
        if not _detected(camera, light, order):
            return None
    electrons, centres = _electrons(camera, light), light.wavelengths_nm
    white = electrons.sum(axis=1)
    surfaces = np.vstack([spectra.surfaces(centres), np.ones(centres.size)])
    balance = np.ones(white.size)
    balance[order] = white[order].max() / white[order]
    raw = surfaces @ electrons.T * balance / white[order].max()  # white is 1 in R, G and B
    return ColourMatrix(balance, _fitted(raw, _seen(surfaces, light), order[1]), name)


def colour_order(filter_names: tuple[str, ...]) -> list[int] | None:
    """Return the numbers of the red, green and blue filter; None without them, so previews stay grey."""
    initials = [name[:1].lower() for name in filter_names]
    return [initials.index(x) for x in "rgb"] if {*"rgb"} <= {*initials} else None


def _electrons(camera: Camera, light: Illuminant) -> Float64Array:
    """Return the electrons of a white surface in each filter and band, shape (F, B), in relative units."""
    centres, power = light
    return np.asarray(flat_field_qe(camera, centres) * power * centres)


def flat_field_qe(camera: Camera, wavelengths_nm: Float64Array) -> Float64Array:
    """Return the QE of each filter in a flat field, with the crosstalk of neighbours, shape (F, B)."""
    detection = detector_of(camera.stages)
    if detection.light_reach_px == 0:
        return camera.qe(wavelengths_nm)
    shape = len(camera.tile), len(camera.tile[0])
    frame, filters = Frame(Exposure(1.0), SensorWindow(0, shape)), camera.filter_index(shape)
    qe = np.empty((len(camera.filter_names), wavelengths_nm.size))
    for band, wavelength_nm in enumerate(wavelengths_nm):
        photons = Photons(np.ones((*shape, 1)), np.array([wavelength_nm]))
        collected = detection.sample(photons, frame).light
        for number in range(len(qe)):
            qe[number, band] = collected[filters == number].mean()
    return qe


def _detected(camera: Camera, light: Illuminant, order: list[int]) -> bool:
    """Return True if red, green and blue detect this light, and an observer sees it."""
    electrons = _electrons(camera, light).sum(axis=1)[order]
    visible = spectra.photopic(light.wavelengths_nm) @ light.power / light.power.sum()
    return bool(min(electrons.min() / electrons.mean(), visible) > LIGHT_FRACTION_MIN)


def standard_light(camera: Camera, name: str) -> Illuminant:
    """Return a CIE illuminant in bands of STEP_NM over the ranges of the camera and an observer."""
    low_nm, high_nm = camera.band_nm
    centres = np.arange(min(low_nm, 380.0), max(high_nm, 780.0) + 1, STEP_NM)
    return Illuminant(centres, spectra.standard_illuminant(name, centres))


def _seen(reflectances: Float64Array, light: Illuminant) -> Float64Array:
    """Return XYZ under the illuminant, adapted to daylight, shape (N, 3); the last surface, white, has Y = 1."""
    xyz = reflectances @ (spectra.observer(light.wavelengths_nm) * light.power).T
    xyz /= xyz[-1, 1]
    return spectra.adapted_to_daylight(xyz, xyz[-1])


def _fitted(raw: Float64Array, wanted: Float64Array, last: int) -> Float64Array:
    """Return the matrix (3, F) from raw values to linear sRGB that keeps the last surface white.

    last : number of a filter for which white is 1; its column follows from the other columns.
    """
    from scipy.optimize import least_squares

    white, lab = spectra.D65_XYZ, spectra.lab(wanted)
    others = np.arange(raw.shape[1]) != last
    off = raw[:, others] - raw[:, [last]] * raw[-1, others]

    def distances(free: Float64Array) -> Float64Array:
        relative_xyz = raw[:, [last]] + off @ free.reshape(-1, 3)
        error = (spectra.lab(white * relative_xyz) - lab).ravel()
        robust = error / np.sqrt(1 + np.abs(error))  # its square is linear in large errors
        noise = 100 * RAW_NOISE * len(raw) ** 0.5 * free  # about the L* of Y, for every surface
        return np.append(robust, noise)

    start = np.linalg.lstsq(off, wanted / white - raw[:, [last]], rcond=None)[0]
    columns = np.empty((3, raw.shape[1]))
    columns[:, others] = least_squares(distances, start.ravel()).x.reshape(-1, 3).T
    columns[:, last] = 1 - columns[:, others] @ raw[-1, others]
    return np.asarray(spectra.XYZ_TO_SRGB @ (white[:, None] * columns))
