"""Spectral irradiance and AOVs as OpenEXR files."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import shown
from ..core.small_files import json_value
from ..files.openexr import Plane, whole_exr, write_planes
from ..files.texts import plain_values

if TYPE_CHECKING:
    from ..render.light.irradiance import Irradiance, RenderedFor
    from ..render.light.statistics import RenderStatistics
    from ..render.motion.aovs import Aovs

SPECTRAL_CHANNEL = "S0."  # Fichet, Pacanowski & Wilkie 2021, "An OpenEXR Layout for Spectral Images", JCGT 10(3)
FILTER_CHANNEL = "channel."
ERROR_CHANNEL = "standard_error."
RELATIVE_ERROR_CHANNEL = "relative_error"
IN_BAND_CHANNEL = "in_band"
PASS_ERROR_CHANNEL = "pass_error"
RAW_LAYER = "raw."
GROUP_LAYER = "light."
HALF_MAX = 65504.0  # largest number in half precision
POWER_MAX = 120  # of two, in a float32 of a header
AOV_LAYERS = {
    "depth_m": ("", "m along the optical axis, inf where no surface is"),
    "position_m": ("XYZ", "m in world space, NaN where no surface is"),
    "normal": ("XYZ", "unit vector in world space, 0 where no surface is"),
    "albedo": ("RGB", "mean diffuse reflectance over 600-700, 500-600, 400-500 nm"),
    "shape_index": ("", "number in shapes, from 0; -1 where no surface is"),
    "flow_px": ("XY", "pixels to the right and down during the exposure"),
}
"""Array of Aovs → components, unit."""


def write_irradiance_exr(path: Path, irradiance: Irradiance, half: bool = False) -> None:
    """Write focal-plane irradiance [W m⁻² nm⁻¹] as float32 spectral EXR; :func:`read_irradiance_exr` is the inverse.

    half : also write the bands in half precision, multiplied by ``half_scale`` of the header, a power of two; the unit
        in the header is divided by it.

    Channels: ``S0.<nm>nm`` are the bands (with a decimal comma as in Fichet et al. 2021, because a dot separates
    layers), or ``channel.<filter>`` for light rendered into colour filters, in W m⁻² at ``reference_nm`` of the header.
    ``standard_error.<nm>nm`` are standard errors in half precision, to 0.05 %, multiplied by ``error_scale``.
    ``relative_error`` is the relative standard error of the electrons, ``pass_error`` the same before denoising.
    ``in_band`` is a factor on the electrons of the camera whose fingerprint is ``response`` in the header.
    Layer ``raw`` contains the light before denoising, layers ``light.<name>`` the light groups; channels outside layers
    are the sum of the groups as rendered.
    Header: ``rendered_for`` is camera (whole datasheet), exposure, serial number and illuminant as JSON;
    ``light_groups`` the statistics and illuminant of each group as JSON; ``polarizers`` the fingerprint of polarisers.
    """
    header: dict[str, str | float] = {
        "spectralLayoutVersion": "1.0",
        "polarisationHandedness": "right",
        "emissiveUnits": "W.m^-2.nm^-1",
        "bandwidths_nm": json.dumps([float(width) for width in irradiance.bandwidths_nm]),
        "render_statistics": json.dumps(irradiance.statistics.to_dict(), default=plain_values),
        "first_pixel": json.dumps(irradiance.origin),
    }
    layers = _layers_of(irradiance)
    errors = [light.standard_error for light in layers.values()]
    scale, error_scale = None, _half_scale(errors)
    if half:
        scale = error_scale = _half_scale([*errors, *(light.data for light in layers.values())])
        header |= {"half_scale": scale, "emissiveUnits": f"{1 / scale!r} W.m^-2.nm^-1"}
    header["error_scale"] = error_scale
    if irradiance.filters is not None:
        names, prefix = list(irradiance.filters), FILTER_CHANNEL
        header |= {"filters": json.dumps(names), "response": irradiance.response or ""}
        header["reference_nm"] = float(irradiance.wavelengths_nm[0])
    else:
        names = [f"{float(nm)!r}nm".replace(".", ",") for nm in irradiance.wavelengths_nm]
        prefix = SPECTRAL_CHANNEL
    if irradiance.in_band is not None:
        header["response"] = irradiance.response or ""
    if irradiance.polarizers is not None:
        header["polarizers"] = irradiance.polarizers
    if irradiance.rendered_for is not None:
        header["rendered_for"] = json.dumps(plain_values(irradiance.rendered_for.to_dict()))
    raw = irradiance.raw
    if raw is not None:
        header["raw_statistics"] = json.dumps(raw.statistics.to_dict(), default=plain_values)
    if irradiance.groups:
        header["light_groups"] = json.dumps(plain_values(_groups_header(irradiance)))
    channels = dict[str, Plane]()
    for layer, light in layers.items():
        channels[layer + RELATIVE_ERROR_CHANNEL] = Plane(light.relative_error)
        if light.in_band is not None:
            channels[layer + IN_BAND_CHANNEL] = Plane(light.in_band)
        if light.pass_error is not None:
            channels[layer + PASS_ERROR_CHANNEL] = Plane(light.pass_error)
        for band, name in enumerate(names):
            error = Plane(light.standard_error[..., band], error_scale)
            channels[layer + prefix + name] = Plane(light.data[..., band], scale)
            channels[layer + ERROR_CHANNEL + name] = error
    write_planes(path, header, channels)


def _layers_of(irradiance: Irradiance) -> dict[str, Irradiance]:
    """Return layer → light: the whole, each light group, and both before denoising."""
    layers = {"": irradiance}
    layers |= {f"{GROUP_LAYER}{name}.": light for name, light in irradiance.groups.items()}
    raw = {f"{layer}{RAW_LAYER}": light.raw for layer, light in layers.items()}
    return layers | {layer: light for layer, light in raw.items() if light is not None}


def _groups_header(irradiance: Irradiance) -> dict[str, object]:
    """Return the header entries of each light group."""
    return {
        name: {
            "statistics": light.statistics.to_dict(),
            "raw": light.raw and light.raw.statistics.to_dict(),
            "illuminant": light.rendered_for and light.rendered_for.to_dict()["illuminant"],
        }
        for name, light in irradiance.groups.items()
    }


def _half_scale(arrays: list[np.ndarray]) -> float:
    """Return the largest power of two that keeps all finite numbers within half precision."""
    most = max(float(np.max(array, initial=0.0, where=np.isfinite(array))) for array in arrays)
    if not most > 0:
        return 1.0
    power = np.floor(np.log2(HALF_MAX / most))
    return float(2.0 ** min(power, POWER_MAX))


def read_irradiance_exr(path: str | os.PathLike[str]) -> Irradiance:
    """Return the light of a file that :func:`write_irradiance_exr` wrote. Raises InputError for other files."""
    wrong = "but not the focal-plane irradiance that `mitsuba-sensor render` writes"
    with whole_exr(Path(path), wrong, "; give an irradiance.exr") as (header, pixels):
        return _irradiance(header, pixels)


def _irradiance(header: Mapping[str, Any], pixels: Mapping[str, np.ndarray]) -> Irradiance:
    """Return the light of the header and channels of an irradiance.exr. Raises ValueError and KeyError for others."""
    from ..render.light.irradiance import Irradiance
    from ..render.light.statistics import RenderStatistics

    statistics_of = RenderStatistics.from_dict
    filters = _names_of(json_value(header["filters"])) if "filters" in header else None
    if filters:
        names, prefix = list(filters), FILTER_CHANNEL
        lengths_nm = [header["reference_nm"]] * len(names)
    else:
        prefix = SPECTRAL_CHANNEL
        bands = [name for name in pixels if name.startswith(prefix)]
        names = [name.removeprefix(prefix) for name in bands]
        names.sort(key=_wavelength_nm)  # EXR sorts names as text
        lengths_nm = [_wavelength_nm(name) for name in names]
    common = {
        "wavelengths_nm": np.array(lengths_nm, dtype=float),
        "bandwidths_nm": _widths_of(json_value(header["bandwidths_nm"]), len(names)),
        "filters": filters,
        "response": header.get("response") or None,
        "polarizers": header.get("polarizers"),
        "origin": _pair_of(json_value(header.get("first_pixel", "[0, 0]"))),
    }

    def stack_bands(kind: str, scale: str) -> np.ndarray:
        stacked = np.stack([pixels[kind + name] for name in names], axis=-1)
        values = stacked.astype(np.float32, copy=False)
        if scale in header:
            values = values / np.float32(header[scale])
        return values

    def light(layer: str, statistics: RenderStatistics) -> dict[str, Any]:
        return {
            **common,
            "data": stack_bands(layer + prefix, "half_scale"),
            "standard_error": stack_bands(layer + ERROR_CHANNEL, "error_scale"),
            "relative_error": pixels[layer + RELATIVE_ERROR_CHANNEL],
            "in_band": pixels.get(layer + IN_BAND_CHANNEL),
            "pass_error": pixels.get(layer + PASS_ERROR_CHANNEL),
            "statistics": statistics,
        }

    raw = None
    if "raw_statistics" in header:
        raw = Irradiance(
            **light(RAW_LAYER, statistics_of(json_value(header["raw_statistics"])))
        )
    rendered_for = _rendered_for(header)
    groups = dict[str, Irradiance]()
    for name, entry in json_value(header.get("light_groups", "{}")).items():
        layer = f"{GROUP_LAYER}{name}."
        raw_group = None
        if entry["raw"] is not None:
            raw_group = Irradiance(**light(layer + RAW_LAYER, statistics_of(entry["raw"])))
        group_for = rendered_for
        if group_for is not None:
            values = group_for.to_dict() | {"illuminant": entry["illuminant"]}
            group_for = group_for.from_dict(values)
        groups[name] = Irradiance(
            **light(layer, statistics_of(entry["statistics"])),
            rendered_for=group_for,
            raw=raw_group,
        )
    return Irradiance(
        **light("", statistics_of(json_value(header["render_statistics"]))),
        rendered_for=rendered_for,
        raw=raw,
        groups=groups,
        levels=dict.fromkeys(groups, 1.0),
    )


def _pair_of(value: object) -> tuple[int, int]:
    """Return row and column of a header. Raises ValueError for other values."""
    match value:
        case [int(row), int(column)]:
            return row, column
    raise ValueError(f"first_pixel is {shown(value)}")


def _widths_of(value: object, bands: int) -> np.ndarray:
    """Return the widths of the bands in a header [nm]. Raises ValueError for other values."""
    widths = np.array(value, dtype=float)
    if widths.shape != (bands,) or not np.isfinite(widths).all():
        raise ValueError(f"bandwidths_nm is {shown(value)}")
    return widths


def _names_of(value: object) -> tuple[str, ...]:
    """Return the names of filters in a header. Raises ValueError for other values."""
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        raise ValueError(f"filters is {shown(value)}")
    return tuple(value)


def rendered_for(path: str | os.PathLike[str]) -> RenderedFor | None:
    """Return what an irradiance.exr was rendered for, without reading its pixels; None if unknown.

    Raises InputError for other files.
    """
    with whole_exr(Path(path), "whose header cannot be read", pixels=False) as (header, _):
        return _rendered_for(header)


def _rendered_for(header: Mapping[str, Any]) -> RenderedFor | None:
    from ..render.light.irradiance import RenderedFor

    if "rendered_for" not in header:
        return None
    return RenderedFor.from_dict(json_value(header["rendered_for"]))


def write_aovs_exr(path: Path, aovs: Aovs) -> None:
    """Write AOVs as float32 EXR, one layer for each array; :func:`read_aovs_exr` is the inverse.

    The header has ``units`` and ``shapes``, the names for the numbers of ``shape_index``, as JSON.
    """
    header: dict[str, str | float] = {
        "units": json.dumps({name: unit for name, (_, unit) in AOV_LAYERS.items()}),
        "shapes": json.dumps(aovs.shapes),
        "scene_sha256": aovs.scene_sha256,
    }
    channels: dict[str, Plane] = {}
    for name, (axes, _) in AOV_LAYERS.items():
        image = np.atleast_3d(getattr(aovs, name))
        for k, layer in enumerate(_layers(name, axes)):
            channels[layer] = Plane(image[..., k])
    write_planes(path, header, channels)


def read_aovs_exr(path: str | os.PathLike[str]) -> Aovs:
    """Return the AOVs of a file that :func:`write_aovs_exr` wrote. Raises InputError for other files."""
    from ..render.motion.aovs import Aovs

    wrong = "without the AOVs that `render --aovs` writes"
    with whole_exr(Path(path), wrong) as (header, pixels):
        arrays: dict[str, np.ndarray] = {}
        for name, (axes, _) in AOV_LAYERS.items():
            images = [pixels[layer] for layer in _layers(name, axes)]
            arrays[name] = np.stack(images, axis=-1) if axes else images[0]
        return Aovs(
            **arrays,
            shapes=tuple(json_value(header["shapes"])),
            scene_sha256=header["scene_sha256"],
        )


def _layers(name: str, axes: str) -> list[str]:
    """Return the names of the EXR channels of one array."""
    return [f"{name}.{axis}" for axis in axes] or [name]


def _wavelength_nm(name: str) -> float:
    return float(name.removesuffix("nm").replace(",", "."))
