"""DNG files of raw frames: the codes of the ADC, and the tags with which other programs develop them.

Tags by their numbers in Adobe's Digital Negative Specification 1.4 and, below ``_exif``, in Exif 2.3.
"""

from __future__ import annotations

import itertools
import os
import struct
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from ..camera.camera import Camera
from ..camera.colour_matrix import STEP_NM, colour_matrix, colour_order, standard_light
from ..camera.figures import QUANTISATION_DN2, figures_if_any, saturation_dn, saturation_e
from ..core import Exposure, Float64Array, InputError
from ..core.checks import require_frame, require_path
from ..files.appearing import appearing
from ..files.texts import to_json
from ..files.tiff import (
    CFA_COLOURS,
    TIFF_BYTE,
    TIFF_LONG,
    TIFF_SHORT,
    TiffTag,
    cfa_tags,
    write_pages,
)
from ..optics import spectra
from ..render.light.photons import photons_per_irradiance
from ..stages.gains import excess_noise
from ..stages.stage import place_of_count
from .dng_lens import lens_corrections
from .frame_files import image_facts

if TYPE_CHECKING:
    from ..sensor.frames import RawFrames

Tag: TypeAlias = TiffTag

# Types of tags, in addition to tiff.py.
ASCII, RATIONAL, UNDEFINED, SRATIONAL, DOUBLE = 2, 5, 7, 10, 12
LARGEST = 2**31 - 1  # numerator and denominator of a fraction, signed or not
PHOTOMETRIC, CFA, LINEAR_RAW = 262, 32803, 34892
# Tag of the Exif directory, and its placeholder, because tifffile writes no tag of that number.
EXIF, EXIF_TO_BE = 34665, 34664
BITS_MAX = 16  # LibRaw reads no deeper integers
SIDE_MIN = 22  # rows and columns: LibRaw opens no smaller pictures
PADDING = 2  # pixels at each edge for the interpolation of colours (Adobe's SDK)
BAYER_SHAPE = 2, 2  # the only tile of our cameras that LibRaw reads
ISO_MAX = 65535  # larger speeds go to RecommendedExposureIndex (Exif 2.3)
INSTEAD = "omit dng: frame.tiff (ms.write_tiff) contains every code"
SATURATION_LX_S = 78.0
"""ISO 12232: the saturation-based speed is this over the focal-plane exposure at saturation."""
LIGHT_SOURCES = {"A": 17, "D65": 21}
"""CIE illuminant → LightSource of Exif, in the order of the tags."""


def check_dng(camera: Camera, shape: tuple[int, ...]) -> None:
    """Raise InputError for a camera, or a frame shape (H, W), whose DNG other programs cannot open."""
    if camera.code_bits > BITS_MAX and not camera.companding.knees:
        raise InputError(
            f"{camera.name} has {camera.code_bits} bits; a DNG has {BITS_MAX}; {INSTEAD}, or set companding.knees."
        )
    if len(camera.filter_names) > 1:
        _check_filters(camera)
    if min(shape[-2:]) < SIDE_MIN:
        raise InputError(
            f"a frame of {shape[-2]} × {shape[-1]} pixels is too small for a DNG: LibRaw opens {SIDE_MIN} × {SIDE_MIN} "
            f"and more; {INSTEAD}."
        )


def _check_filters(camera: Camera) -> None:
    """Raise InputError for colour filters that readers of DNG do not support."""
    names, tile = camera.filter_names, np.shape(camera.tile)
    are_rgb = sorted(name[:1].lower() for name in names) == sorted(CFA_COLOURS)
    if not are_rgb or tile != BAYER_SHAPE or len(set(np.ravel(camera.tile))) < 3:
        raise InputError(
            f"{camera.name} has filters {', '.join(names)} in a tile of {tile[0]} × {tile[1]}; a DNG needs red, green "
            f"and blue in 2 × 2, or no filters; {INSTEAD}."
        )
    if colour_matrix(camera) is None:
        raise InputError(
            f"{camera.name} has a filter that detects no daylight, so its colours are undefined; {INSTEAD}."
        )


def dng_names(frames: RawFrames) -> list[str]:
    """Return the names of the DNGs: frame.dng, or frame_0008.dng, frame_0009.dng … by frame number."""
    first, count = frames.first.index, len(frames.digital)
    if count == 1:
        return ["frame.dng"]
    return [f"frame_{number:04d}.dng" for number in range(first, first + count)]


def write_dng(path: str | os.PathLike[str], frames: RawFrames, number: int = 0) -> None:
    """Write one of the frames as a DNG 1.4, unchanged and uncompressed. Raises InputError; see :func:`check_dng`."""
    check_dng(frames.camera, frames.digital.shape)
    number = require_frame(number, len(frames.digital))
    facts, tags = image_facts(frames) | {"frames": 1}, list(_about(frames))
    is_colour = len(frames.camera.filter_names) > 1
    tags += _colours(frames, facts["cfa_pattern"]) if is_colour else _levels(frames, 1)
    pixels = frames.digital[number]
    if frames.camera.companding.knees:
        pixels = frames.camera.companding.compand(pixels)
        tags.append(_tag(50712, TIFF_SHORT, *linearization_table(frames.camera)))
    with appearing(require_path("path", path, "frame.dng"), pixels.nbytes) as temporary:
        write_pages(temporary, pixels, to_json(facts).encode(), tags)
        _finish(temporary, CFA if is_colour else LINEAR_RAW, list(_exif(frames)))


def _about(frames: RawFrames) -> Iterator[Tag]:
    """Yield the tags of version, camera, orientation, lens corrections and noise."""
    name = frames.camera.name.encode("ascii", "replace").decode()
    # NewSubfileType: the main picture, which Adobe's SDK requires.
    yield _tag(254, TIFF_LONG, 0)
    yield _tag(50706, TIFF_BYTE, 1, 4, 0, 0)  # DNGVersion
    # DNGBackwardVersion
    yield _tag(50707, TIFF_BYTE, 1, 1, 0, 0)
    yield 271, ASCII, 0, "mitsuba_sensor", True  # Make, which LibRaw requires
    yield 272, ASCII, 0, name, True  # Model
    yield 50708, ASCII, 0, name, True  # UniqueCameraModel
    # Orientation: first row at the top, first column on the left.
    yield _tag(274, TIFF_SHORT, 1)
    yield _tag(EXIF_TO_BE, TIFF_LONG, 0)  # placeholder
    corrections = lens_corrections(frames.camera, frames.light.intrinsics)
    if corrections:
        yield 51022, UNDEFINED, len(corrections), corrections, True  # OpcodeList3
    profile = noise_profile(frames)
    if profile is not None:
        colours = 3 if len(frames.camera.filter_names) > 1 else 1
        yield _tag(51041, DOUBLE, *(profile * colours))  # NoiseProfile


def _levels(frames: RawFrames, side: int) -> Iterator[Tag]:
    """Yield BlackLevelRepeatDim, BlackLevel of side × side pixels, and WhiteLevel."""
    camera, steps = frames.camera, steps_of_table(frames.camera)
    black_dn = camera.black_level_dn / steps
    yield _tag(50713, TIFF_SHORT, side, side)
    yield _tag(50714, RATIONAL, *[black_dn] * side**2)
    white_dn = saturation_dn(camera)
    if camera.companding.knees:
        white_dn = min(round(white_dn / steps), max(linearization_table(camera)))
    yield _tag(50717, TIFF_LONG, white_dn)


def steps_of_table(camera: Camera) -> int:
    """Return the linear codes in one step of the LinearizationTable, whose values have 16 bits."""
    if not camera.companding.knees:
        return 1
    return int(2 ** max(camera.code_bits - BITS_MAX, 0))


def linearization_table(camera: Camera) -> list[int]:
    """Return the LinearizationTable of DNG 1.4: the linear code of every companded code, with at most 16 bits."""
    linear = np.floor(camera.companding.linear_codes() / steps_of_table(camera) + 0.5)
    return [int(value) for value in np.minimum(linear, 2**BITS_MAX - 1)]


def noise_profile(frames: RawFrames) -> tuple[float, float] | None:
    """Return (S, O) of DNG 1.4: the temporal variance of a pixel is S·x + O, with x = 0 at black and x = 1 at white.

    S = F²·K/(white − black) and O = (K²·σ_d² + σ_q²)/(white − black)², with EMVA 1288's overall system gain K of small
    signals, temporal dark noise σ_d and quantisation noise σ_q² = 1/12 DN²; F² is the excess noise of an EMCCD, else 1.
    Dark current is treated as signal, because it has shot noise. None for cameras without shot noise, which have no S.
    """
    camera, figures = frames.camera, figures_if_any(frames.camera)
    shot = place_of_count(camera.stages) > 0
    if figures is None or not shot or (frames.plan is None and frames.stages != camera.stages):
        return None
    span_dn = saturation_dn(camera) - camera.black_level_dn
    gain_dn_per_e = figures.system_gain_dn_per_e
    dark_dn2 = (gain_dn_per_e * figures.temporal_dark_noise_e) ** 2 + QUANTISATION_DN2
    return excess_noise(camera) * gain_dn_per_e / span_dn, dark_dn2 / span_dn**2


def _colours(frames: RawFrames, pattern: Sequence[Sequence[str]]) -> Iterator[Tag]:
    """Yield the tags of mosaic, levels and colour matrices, and of white if the illuminant is known."""
    camera, illuminant = frames.camera, frames.light.illuminant
    yield from cfa_tags(pattern)
    yield _tag(50710, TIFF_BYTE, 0, 1, 2)  # CFAPlaneColor: red, green, blue
    yield _tag(50711, TIFF_SHORT, 1)  # CFALayout: a rectangle
    yield from _levels(frames, BAYER_SHAPE[0])
    # DefaultCropOrigin and DefaultCropSize: without edge pixels, whose colours would be extrapolated.
    rows, columns = frames.digital.shape[1:]
    yield _tag(50719, TIFF_LONG, PADDING, PADDING)
    yield _tag(50720, TIFF_LONG, columns - 2 * PADDING, rows - 2 * PADDING)
    for place, calibration in enumerate(calibrations(camera)):
        # CalibrationIlluminant1, ColorMatrix1 and ForwardMatrix1, then the second ones.
        yield _tag(50778 + place, TIFF_SHORT, calibration.light_source)
        yield _tag(50721 + place, SRATIONAL, *calibration.to_raw.ravel())
        yield _tag(50964 + place, SRATIONAL, *calibration.to_xyz.ravel())
    matrix, order = colour_matrix(camera, illuminant), colour_order(camera.filter_names)
    if matrix is not None and matrix.illuminant == "scene":
        yield _tag(50728, RATIONAL, *1.0 / matrix.white_balance[order])  # AsShotNeutral


def _exif(frames: RawFrames) -> Iterator[Tag]:
    """Yield the Exif tags of exposure time, f-number and ISO speed, if known."""
    camera, time_s = frames.camera, frames.first.exposure.time_s
    if time_s <= LARGEST:
        yield _tag(33434, RATIONAL, time_s)  # ExposureTime
    if camera.lens.f_number is not None:
        yield _tag(33437, RATIONAL, camera.lens.f_number)  # FNumber
    speed = iso_speed(camera) if figures_if_any(camera) is not None else None
    if speed is not None:
        iso = min(max(round(speed), 1), LARGEST)
        yield _tag(34855, TIFF_SHORT, min(iso, ISO_MAX))  # ISOSpeedRatings
        yield _tag(34864, TIFF_SHORT, 2)  # SensitivityType: RecommendedExposureIndex
        yield _tag(34866, TIFF_LONG, iso)  # RecommendedExposureIndex
    yield 36864, UNDEFINED, 4, b"0230", True  # ExifVersion


def _tag(code: int, kind: int, *values: float) -> Tag:
    """Return a tag of numbers; fractions become numerator and denominator."""
    content: bytes | tuple[float, ...] = values
    if kind in (RATIONAL, SRATIONAL):
        content = tuple(itertools.chain.from_iterable(map(_rational, values)))
    elif kind == TIFF_BYTE:
        content = bytes(map(int, values))
    return code, kind, len(values), content, True


def _rational(value: float) -> tuple[int, int]:
    """Return the nearest fraction whose numerator and denominator have 31 bits."""
    most = int(LARGEST / max(abs(value), 1.0))
    return Fraction(float(value)).limit_denominator(most).as_integer_ratio()


def _finish(file: Path, photometric: int, exif: Sequence[Tag]) -> None:
    """Write what tifffile cannot write: the Exif directory, and LinearRaw of one value per pixel."""
    with file.open("r+b") as opened:
        end = opened.seek(0, os.SEEK_END)
        place = end + end % 2
        opened.write(bytes(end % 2) + _directory(exif, place))
        replaced = {
            PHOTOMETRIC: (PHOTOMETRIC, TIFF_SHORT, 1, photometric),
            EXIF_TO_BE: (EXIF, TIFF_LONG, 1, place),
        }
        opened.seek(4)
        (start,) = struct.unpack("<I", opened.read(4))
        opened.seek(start)
        (count,) = struct.unpack("<H", opened.read(2))
        entries = opened.read(12 * count)
        for number in range(count):
            (code,) = struct.unpack_from("<H", entries, 12 * number)
            if code in replaced:
                opened.seek(start + 2 + 12 * number)
                opened.write(struct.pack("<HHII", *replaced[code]))


def _directory(tags: Sequence[Tag], place: int) -> bytes:
    """Return a TIFF directory that starts at byte ``place``, with its tags in the order of their numbers."""
    entries, behind = struct.pack("<H", len(tags)), b""
    start = place + 2 + 12 * len(tags) + 4
    for code, kind, count, value, _ in sorted(tags):
        content = value
        if kind != UNDEFINED:
            letter = "H" if kind == TIFF_SHORT else "I"
            content = struct.pack(f"<{len(value)}{letter}", *value)
        inside = content
        if len(content) > 4:
            inside = struct.pack("<I", start + len(behind))
            behind += content
        entries += struct.pack("<HHI4s", code, kind, count, inside)
    return entries + bytes(4) + behind


def iso_speed(camera: Camera) -> float | None:
    """Return the ISO speed of the gain setting, or else S_sat = 78 lx·s/H_sat.

    H_sat is the exposure to CIE D65 at which the most sensitive pixels saturate. Raises InputError if dark pixels are
    at the full-scale code.
    """
    for setting in camera.gains:
        if setting.label == camera.gain and setting.iso is not None:
            return float(setting.iso)
    middles, power = standard_light(camera, spectra.DAYLIGHT)
    bands = photons_per_irradiance(
        camera, Exposure(1.0), middles, np.full(middles.size, STEP_NM)
    )
    electrons_per_lx_s = camera.qe(middles) @ (bands * power) / spectra.luminous(middles, power)
    return float(SATURATION_LX_S * electrons_per_lx_s.max() / saturation_e(camera)) or None


class Calibration(NamedTuple):
    """Colour calibration of a camera under one illuminant (DNG 1.4, chapter 6).

    light_source : the illuminant, a LightSource of Exif.
    to_raw : ColorMatrix from XYZ to raw red, green and blue, shape (3, 3); the largest raw value of white with Y = 1
        is 1.
    to_xyz : ForwardMatrix from balanced red, green and blue to XYZ adapted to D50, shape (3, 3).
    """

    light_source: int
    to_raw: Float64Array
    to_xyz: Float64Array


def calibrations(camera: Camera) -> tuple[Calibration, ...]:
    """Return the calibrations of an RGB camera under each illuminant that all filters detect; () for other cameras."""
    matrices = (_calibrate(camera, name) for name in LIGHT_SOURCES)
    return tuple(calibration for calibration in matrices if calibration is not None)


def _calibrate(camera: Camera, name: str) -> Calibration | None:
    """Convert the colour matrix of the preview (colour_matrix.py) under this illuminant to the matrices of DNG, whose
    readers adapt colours by the linear Bradford method."""
    light, order = standard_light(camera, name), colour_order(camera.filter_names)
    matrix = colour_matrix(camera, light)
    if matrix is None or order is None or matrix.illuminant != "scene":
        return None
    to_d50 = spectra.bradford(spectra.D65_XYZ, spectra.D50_XYZ)
    srgb_to_d50 = to_d50 @ np.linalg.inv(spectra.XYZ_TO_SRGB)
    to_xyz = srgb_to_d50 @ matrix.to_srgb[:, order]
    white = spectra.observer(light.wavelengths_nm) @ light.power
    from_d50 = spectra.bradford(spectra.D50_XYZ, white / white[1])
    to_raw = np.linalg.inv(from_d50 @ to_xyz * matrix.white_balance[order])
    return Calibration(LIGHT_SOURCES[name], np.asarray(to_raw, np.float64), to_xyz)
