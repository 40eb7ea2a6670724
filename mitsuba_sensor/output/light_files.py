"""Readers of irradiance: irradiance.exr, and EXRs of other programs, whose unit must be given."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterable
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ..camera.camera import Camera
from ..camera.camera_file import load_camera
from ..core import Float64Array, InputError, nearest, require
from ..core.checks import require_path
from ..core.units import LIGHT_SPEED_M_PER_S
from ..files.openexr import whole_exr
from ..optics.spectra import rgb_to_srgb
from .exr import read_irradiance_exr

if TYPE_CHECKING:
    from ..render.light.irradiance import Irradiance

UNITS = {
    "w_per_m2_nm": "irradiance on the sensor in W m⁻² nm⁻¹, channels S0.<wavelength>nm",
    "w_per_m2": "irradiance on the sensor in W m⁻², one channel, with wavelength_nm",
    "radiance_w_per_m2_sr_nm": "radiance in front of the lens in W m⁻² sr⁻¹ nm⁻¹, channels S0.<wavelength>nm",
    "radiance_w_per_m2_sr": "radiance in front of the lens in W m⁻² sr⁻¹, one channel, with wavelength_nm",
    "radiance_rgb": "linear sRGB in front of the lens as Mitsuba has it: 1, 1, 1 is D65 of 73 000 cd/m²",
}
OWN_ENTRY = "render_statistics"  # only the header of an irradiance.exr has it
SPECTRAL = re.compile(
    r"(?:(.*)\.)?S0\.(\d*[.,]?\d+(?:[eE][+-]?\d+)?)(Y|Z|E|P|T|G|M|k|h|da|d|c|m|u|n|p)?(m|Hz)"
)
POWERS = dict(zip("YZEPTGMkh", (24, 21, 18, 15, 12, 9, 6, 3, 2), strict=True))
POWERS |= {"da": 1, "": 0, "d": -1, "c": -2, "m": -3, "u": -6, "n": -9, "p": -12}
"""Prefix of a unit → power of ten."""
PRIMARIES_TOLERANCE = 1e-3  # chromaticities are often written with three digits
T = TypeVar("T")
BANDWIDTH_NM = 1.0  # of light of one wavelength


def read_irradiance(
    path: str | os.PathLike[str],
    unit: str | None = None,
    wavelength_nm: float | None = None,
    camera: Camera | str | None = None,
    fov_deg: float | None = None,
    layer: str | None = None,
) -> Irradiance:
    """Return irradiance at the focal plane from an irradiance.exr, or from an EXR of another program.

    ::

        light = ms.read_irradiance("out/irradiance.exr")
        frames = ms.expose(light, exposure=ms.Exposure(0.001))

    unit : unit of another program's file, one of UNITS.
    wavelength_nm : wavelength of a single channel.  camera : camera whose lens transmits a radiance.
    fov_deg : horizontal field of view of a radiance for the cos⁴ fall-off of the lens. Default: no fall-off.
    layer : layer or part that contains the light, or the channel if the unit is of one channel.
    The image is the display window; RGB of other primaries (``chromaticities`` in the header) becomes sRGB.
    Raises InputError for unreadable files, and for missing or superfluous unit, wavelength, camera or layer.
    """
    file = require_path("path", path, "out/irradiance.exr")
    with whole_exr(file, "that cannot be read", pixels=False) as (header, names):
        is_own = OWN_ENTRY in header
    if is_own:
        if any(given is not None for given in (unit, wavelength_nm, fov_deg, layer)):
            raise InputError(
                f"{file} is an irradiance.exr, whose unit, wavelengths and lens are known; omit unit=, wavelength_nm=, "
                "fov_deg= and layer=."
            )
        return read_irradiance_exr(file)
    if unit not in UNITS:
        given, near = "without a unit", ""
        if unit is not None:
            given, near = f"and unit is {unit!r}", nearest(unit, UNITS)
        raise InputError(
            f"{file} is an EXR of another program (channels {_show_names(names)}) {given}; give unit=, one of "
            f"{', '.join(UNITS)}.{near}"
        )
    if unit.startswith("radiance") and camera is None:
        raise InputError(
            f"unit is {unit!r}, which is before the lens; give the camera with the lens in camera=."
        )
    if fov_deg is not None and not unit.startswith("radiance"):
        raise InputError(f"fov_deg is only for radiance, but unit is {unit!r}; omit fov_deg=.")
    if isinstance(camera, str):
        camera = load_camera(camera)
    return _foreign(file, unit, wavelength_nm, camera, fov_deg, layer)


def _foreign(
    file: Path,
    unit: str,
    wavelength_nm: float | None,
    camera: Camera | None,
    fov_deg: float | None,
    layer: str | None,
) -> Irradiance:
    """Return the irradiance of another program's EXR in one of UNITS."""
    from ..render.light import foreign_light

    with whole_exr(file, "that cannot be read") as (header, channels):
        pixels = {name: np.asarray(image, dtype=np.float32) for name, image in channels.items()}
    notes, negative = [f"read as {UNITS[unit]}"], 0
    if wavelength_nm is not None and unit not in ("w_per_m2", "radiance_w_per_m2_sr"):
        raise InputError(
            f"wavelength_nm is only for one channel, but unit is {unit!r}; omit wavelength_nm=."
        )
    if unit == "radiance_rgb":
        assert camera is not None
        rgb, converted = _srgb(file, _rgb(file, pixels, layer), header.get("chromaticities"))
        if not np.isfinite(rgb).all():
            raise InputError(f"{file} has RGB values that are not finite; correct them.")
        negative = int((rgb < 0).sum())
        bands = foreign_light.upsampled(np.maximum(rgb, 0.0), camera)
        notes += [*converted, foreign_light.UPSAMPLED]
    elif unit.endswith("_nm"):
        bands = foreign_light.Bands(*_spectral(file, pixels, unit, layer))
    else:
        bands = foreign_light.Bands(*_one_channel(file, pixels, wavelength_nm, unit, layer))
    sha256 = hashlib.sha256(file.read_bytes()).hexdigest()
    if not unit.startswith("radiance"):
        return foreign_light.irradiance_of(bands, tuple(notes), sha256)
    assert camera is not None
    bands, how = foreign_light.behind_lens(bands, camera, fov_deg)
    light = foreign_light.irradiance_of(bands, (*notes, how), sha256, negative)
    return foreign_light.behind_glare(light, camera)


def _rgb(file: Path, pixels: dict[str, np.ndarray], layer: str | None) -> np.ndarray:
    """Return the RGB image of a layer, shape (H, W, 3)."""
    layers = dict[str, list[str]]()
    for name in pixels:
        before, _, last = name.rpartition(".")
        names = [name[:-1] + colour for colour in "RGB"]
        if last == "R" and pixels.keys() >= {*names}:
            layers[before] = names
    if not layers:
        raise InputError(
            f"{file} has no channels R, G and B ({_show_names(pixels)}); give another unit=."
        )
    return np.stack([pixels[name] for name in _chosen(file, layers, layer)], axis=-1)


def _chosen(file: Path, layers: dict[str, T], layer: str | None) -> T:
    """Return the entry of a layer. Default: channels outside layers, or the only layer. Raises InputError."""
    if layer is None and (len(layers) == 1 or "" in layers):
        return layers.get("") or next(iter(layers.values()))
    if layer in layers:
        return layers[layer]
    named = ", ".join(repr(name) if name else "channels outside layers" for name in layers)
    if layer is None:
        raise InputError(f"{file} has several layers; choose layer=, one of {named}.")
    raise InputError(
        f"{file} has no layer {layer!r}; choose {named}.{nearest(str(layer), layers)}"
    )


def _srgb(
    file: Path, rgb: np.ndarray, chromaticities: tuple[float, ...] | None
) -> tuple[np.ndarray, list[str]]:
    """Return linear sRGB of RGB with the primaries of the header, and notes."""
    if chromaticities is None:
        return rgb, []
    told = ", ".join(f"{x:.4g}" for x in chromaticities)
    try:
        matrix = rgb_to_srgb(chromaticities)
    except ValueError:
        raise InputError(
            f"{file} has chromaticities {told} in its header, which do not span a triangle; correct or remove them."
        ) from None
    if np.allclose(matrix, np.eye(3), atol=PRIMARIES_TOLERANCE):
        return rgb, []
    with np.errstate(all="ignore"):  # infinite values are rejected later
        converted = (rgb @ matrix.T).astype(np.float32)
    return converted, [f"converted from the primaries {told} to sRGB"]


def _spectral(
    file: Path, pixels: dict[str, np.ndarray], unit: str, layer: str | None
) -> tuple[np.ndarray, Float64Array, Float64Array]:
    """Return bands, wavelengths and widths, sorted by wavelength; bands end halfway between two wavelengths."""
    layers = dict[str, dict[float, str]]()
    for name in pixels:
        match = SPECTRAL.fullmatch(name)
        if match is not None:
            before, *length = match.groups()
            layers.setdefault(before or "", {})[_length_nm(*length)] = name
    names = _chosen(file, layers, layer) if layers else {}
    if len(names) < 2:
        remedy = "another unit"
        if len(pixels) == 1:
            remedy = f"{unit.removesuffix('_nm')} and wavelength_nm="
        raise InputError(
            f"{file} has {len(names)} channels S0.<wavelength>nm ({_show_names(pixels)}), but {unit} needs at "
            f"least two; give {remedy}."
        )
    centres = np.array(sorted(names))
    middles = 0.5 * (centres[1:] + centres[:-1])
    first_edge, last_edge = 2 * centres[0] - middles[0], 2 * centres[-1] - middles[-1]
    edges = np.concatenate([[first_edge], middles, [last_edge]])
    bands = np.stack([pixels[names[nm]] for nm in centres.tolist()], axis=-1)
    return bands, 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)


def _show_names(names: Iterable[str]) -> str:
    """Return the first names of channels for a message, because a file may have any number of them."""
    first = list(islice(names, 5))
    shown = [name[:40] if name.isprintable() else repr(name[:40]) for name in first[:4]]
    if len(first) > 4:
        shown.append("…")
    return ", ".join(shown)


def _length_nm(number: str, prefix: str | None, unit: str) -> float:
    """Return the wavelength in a channel name (Fichet et al. 2021), with a decimal comma or dot."""
    value, power = float(number.replace(",", ".")), POWERS[prefix or ""]
    if unit == "m":
        return value * 10.0 ** (power + 9)
    return 1e9 * LIGHT_SPEED_M_PER_S / (value * 10.0**power)


def _one_channel(
    file: Path,
    pixels: dict[str, np.ndarray],
    wavelength_nm: float | None,
    unit: str,
    layer: str | None,
) -> tuple[np.ndarray, Float64Array, Float64Array]:
    """Return bands, wavelengths and widths of light of one wavelength."""
    if layer is None and len(pixels) != 1:
        raise InputError(
            f"{file} has {len(pixels)} channels ({_show_names(pixels)}), but {unit} is for one; choose layer=, "
            "or give another unit=."
        )
    image = _chosen(file, {name: [x] for name, x in pixels.items()}, layer)[0]
    if wavelength_nm is None:
        raise InputError(
            f"unit is {unit!r}, which is for one wavelength; give it, e.g. wavelength_nm=550."
        )
    centre_nm = require("wavelength_nm", wavelength_nm, 1.0, 1e5, "nanometres, e.g. 550")
    return image[..., None] / BANDWIDTH_NM, np.array([centre_nm]), np.array([BANDWIDTH_NM])
