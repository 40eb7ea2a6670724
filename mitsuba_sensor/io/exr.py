"""Spectral irradiance and AOVs as OpenEXR files; each appears whole or not at all (files.py)."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core import InputError
from .files import appearing, plain_values

if TYPE_CHECKING:
    from ..render.aovs import Aovs
    from ..render.irradiance import Irradiance

EXR_MAGIC = b"\x76\x2f\x31\x01"  # OpenEXR file layout, "Magic Number"
SPECTRAL_CHANNEL = "S0."  # Fichet, Pacanowski & Wilkie 2021, "An OpenEXR Layout for Spectral Images", JCGT 10(3)
FILTER_CHANNEL = "channel."
ERROR_CHANNEL = "standard_error."
RELATIVE_ERROR_CHANNEL = "relative_error"
AOV_LAYERS = {  # array of Aovs → its components, its unit
    "depth_m": ("", "m along the optical axis, inf where nothing is"),
    "position_m": ("XYZ", "m in world space, NaN where nothing is"),
    "normal": ("XYZ", "unit vector in world space, 0 where nothing is"),
    "albedo": ("RGB", "mean diffuse reflectance over 600-700, 500-600, 400-500 nm"),
    "shape_index": ("", "number in shapes, from 0; -1 where nothing is"),
    "flow_px": ("XY", "pixels to the right and down during the exposure"),
}


def write_irradiance_exr(path: Path, irradiance: Irradiance) -> None:
    """Focal-plane irradiance [W m⁻² nm⁻¹] as float32 spectral EXR; :func:`read_irradiance_exr` is its inverse.

    Channels ``S0.<nm>nm`` hold the bands and ``standard_error.<nm>nm`` their standard errors in the same unit (decimal
    comma, as Fichet et al. 2021 have it, because a dot separates layers); ``relative_error`` that of the electrons.
    What was rendered into colour filters has ``channel.<filter>`` instead, in W m⁻² at the wavelength in the header.
    """
    header: dict[str, str | float] = {
        "spectralLayoutVersion": "1.0",
        "polarisationHandedness": "right",
        "emissiveUnits": "W.m^-2.nm^-1",
        "bandwidths_nm": json.dumps([float(width) for width in irradiance.bandwidths_nm]),
        "render_statistics": json.dumps(irradiance.statistics.to_dict(), default=plain_values),
    }
    header["first_pixel"] = json.dumps(irradiance.origin)
    if irradiance.filters is not None:
        header |= {"filters": json.dumps(irradiance.filters), "response": irradiance.response or ""}
        header["reference_nm"] = float(irradiance.wavelengths_nm[0])
    channels = {RELATIVE_ERROR_CHANNEL: _float32(irradiance.relative_error)}
    for band, wavelength_nm in enumerate(irradiance.wavelengths_nm):
        if irradiance.filters is None:
            name, prefix = f"{float(wavelength_nm)!r}nm".replace(".", ","), SPECTRAL_CHANNEL
        else:
            name, prefix = irradiance.filters[band], FILTER_CHANNEL
        channels[prefix + name] = _float32(irradiance.data[..., band])
        channels[ERROR_CHANNEL + name] = _float32(irradiance.standard_error[..., band])
    _write_exr(path, header, channels)


def read_irradiance_exr(path: str | os.PathLike[str]) -> Irradiance:
    """What :func:`write_irradiance_exr` wrote.

    Raises InputError for anything else: no such file, not an EXR, no spectrum in it, cut short.
    """
    from ..render.irradiance import Irradiance
    from ..render.statistics import RenderStatistics

    header, pixels = _whole_exr(Path(path))
    filters = tuple(json.loads(header["filters"])) if "filters" in header else None
    names, prefix = (filters, FILTER_CHANNEL) if filters else (_band_names(pixels), SPECTRAL_CHANNEL)
    try:
        lengths = [header["reference_nm"]] * len(names) if filters else [_wavelength_nm(name) for name in names]
        return Irradiance(
            data=np.stack([pixels[prefix + name] for name in names], axis=-1),
            wavelengths_nm=np.array(lengths, dtype=float),
            bandwidths_nm=np.array(json.loads(header["bandwidths_nm"]), dtype=float),
            standard_error=np.stack([pixels[ERROR_CHANNEL + name] for name in names], axis=-1),
            relative_error=pixels[RELATIVE_ERROR_CHANNEL],
            statistics=_rebuilt(RenderStatistics, json.loads(header["render_statistics"])),
            filters=filters,
            response=header.get("response") or None,
            origin=tuple(json.loads(header.get("first_pixel", "[0, 0]"))),
        )
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(
            f"{path} is an EXR but not the focal-plane irradiance that `mitsuba-sensor render` writes "
            f"(missing or unreadable: {error}); give an irradiance.exr."
        ) from error


def write_aovs_exr(path: Path, aovs: Aovs) -> None:
    """AOVs as float32 EXR, one layer for each of its arrays; :func:`read_aovs_exr` is its inverse.

    The header has ``units`` and ``shapes``, the names behind the numbers of ``shape_index``, as JSON.
    """
    header = {
        "units": json.dumps({name: unit for name, (_, unit) in AOV_LAYERS.items()}),
        "shapes": json.dumps(aovs.shapes),
        "scene_sha256": aovs.scene_sha256,
    }
    channels: dict[str, np.ndarray] = {}
    for name, (axes, _) in AOV_LAYERS.items():
        image = np.atleast_3d(getattr(aovs, name))
        channels |= {layer: _float32(image[..., k]) for k, layer in enumerate(_layers(name, axes))}
    _write_exr(path, header, channels)


def read_aovs_exr(path: str | os.PathLike[str]) -> Aovs:
    """What :func:`write_aovs_exr` wrote. Raises InputError for anything else."""
    from ..render.aovs import Aovs

    header, pixels = _whole_exr(Path(path))
    try:
        arrays = {
            name: np.stack([pixels[layer] for layer in _layers(name, axes)], axis=-1) if axes else pixels[name]
            for name, (axes, _) in AOV_LAYERS.items()
        }
        return Aovs(**arrays, shapes=tuple(json.loads(header["shapes"])), scene_sha256=header["scene_sha256"])
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(
            f"{path} is an EXR without the AOVs that `render --aovs` writes (missing or unreadable: {error})."
        ) from error


def _float32(image: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(image, dtype=np.float32)


def _write_exr(path: Path, header: dict[str, Any], channels: dict[str, np.ndarray]) -> None:
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **header}
    with appearing(path) as temporary:
        try:
            with OpenEXR.File(header, channels) as file:
                file.write(str(temporary))
        except (RuntimeError, ValueError) as error:  # whatever went wrong
            raise OSError(str(error)) from error
        if temporary.stat().st_size == 0:  # a file below 4 kB meets a full disk without an error
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _whole_exr(path: Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header and channels of an EXR; InputError if it is not there, not an EXR or not whole."""
    import OpenEXR

    require_exr(path)
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            return dict(file.header()), {name: channel.pixels for name, channel in file.channels().items()}
    except (RuntimeError, ValueError) as error:
        raise InputError(f"{path} cannot be read as an OpenEXR file ({error}); render it again.") from error


def _layers(name: str, axes: str) -> list[str]:
    """Names of the EXR channels of one array."""
    return [f"{name}.{axis}" for axis in axes] or [name]


def is_exr(path: str | os.PathLike[str]) -> bool:
    """Whether there is an OpenEXR file of that name, by its first bytes."""
    try:
        with Path(path).open("rb") as file:
            return file.read(len(EXR_MAGIC)) == EXR_MAGIC
    except OSError:
        return False


def require_exr(path: Path) -> None:
    """Raise InputError for anything that is not an OpenEXR file."""
    try:
        with path.open("rb") as file:
            magic = file.read(len(EXR_MAGIC))
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}; give an irradiance.exr from `render`.") from error
    if magic != EXR_MAGIC:
        raise InputError(f"{path} is not an OpenEXR file; give an irradiance.exr that `mitsuba-sensor render` wrote.")


def _band_names(pixels: dict[str, np.ndarray]) -> list[str]:
    """The part of the band channels' names after the prefix, by rising wavelength (EXR sorts them as text)."""
    names = [name.removeprefix(SPECTRAL_CHANNEL) for name in pixels if name.startswith(SPECTRAL_CHANNEL)]
    return sorted(names, key=_wavelength_nm)


def _wavelength_nm(name: str) -> float:
    return float(name.removesuffix("nm").replace(",", "."))


def _rebuilt(kind: type, fields: dict[str, Any]) -> Any:
    """A frozen record from its dict; JSON's lists are tuples again."""
    return kind(**{key: tuple(value) if isinstance(value, list) else value for key, value in fields.items()})
