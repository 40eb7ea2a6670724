"""Spectral irradiance and AOVs as OpenEXR files; each appears whole or not at all (appearing.py)."""

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
MOST_HALF = 65504.0  # largest number in half precision
MOST_POWER = 120  # of two, in a float32 of a header
AOV_LAYERS = {
    "depth_m": ("", "m along the optical axis, inf where nothing is"),
    "position_m": ("XYZ", "m in world space, NaN where nothing is"),
    "normal": ("XYZ", "unit vector in world space, 0 where nothing is"),
    "albedo": ("RGB", "mean diffuse reflectance over 600-700, 500-600, 400-500 nm"),
    "shape_index": ("", "number in shapes, from 0; -1 where nothing is"),
    "flow_px": ("XY", "pixels to the right and down during the exposure"),
}
"""Array of Aovs → its components, its unit."""


def write_irradiance_exr(path: Path, irradiance: Irradiance, half: bool = False) -> None:
    """Focal-plane irradiance [W m⁻² nm⁻¹] as float32 spectral EXR; :func:`read_irradiance_exr` is its inverse.

    half : also the bands in half precision, multiplied by ``half_scale`` of the header, a power of two at which the
        brightest one is just below the largest number; the unit in the header is divided by it.

    Channels ``S0.<nm>nm`` hold the bands (decimal comma, as Fichet et al. 2021 have it, because a dot separates
    layers). ``standard_error.<nm>nm`` are their standard errors in half precision, to 0.05 %, multiplied by
    ``error_scale`` of the header: half of the size of a file were digits of noise. ``relative_error`` is that of the
    electrons, ``pass_error`` that of the electrons before denoising.
    ``in_band`` is the factor on the electrons of the camera whose fingerprint is ``response`` in the header.
    ``rendered_for`` in the header is camera (its whole datasheet), exposure, serial number and illuminant as JSON.
    Light that was kept as it was before denoising has the same channels in the layer ``raw``.
    Light groups have the same channels in the layers ``light.<name>``; what is outside of layers is their sum, each as
    it was rendered. ``light_groups`` in the header has the statistics and the illuminant of each as JSON.
    Light that was rendered behind polarisers has their fingerprint as ``polarizers`` in the header.
    What was rendered into colour filters has ``channel.<filter>`` instead, in W m⁻² at the wavelength in the header.
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
        scale = error_scale = _half_scale([*errors, *(one.data for one in layers.values())])
        header |= {"half_scale": scale, "emissiveUnits": f"{1 / scale!r} W.m^-2.nm^-1"}
    header["error_scale"] = error_scale
    if irradiance.filters is not None:
        names, prefix = list(irradiance.filters), FILTER_CHANNEL
        header |= {"filters": json.dumps(names), "response": irradiance.response or ""}
        header["reference_nm"] = float(irradiance.wavelengths_nm[0])
    else:
        lengths = [f"{float(wavelength_nm)!r}nm" for wavelength_nm in irradiance.wavelengths_nm]
        names, prefix = [length.replace(".", ",") for length in lengths], SPECTRAL_CHANNEL
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
    """Layer → its light: the whole, that before denoising, and both of each light group."""
    found = {"": irradiance}
    found |= {f"{GROUP_LAYER}{name}.": light for name, light in irradiance.groups.items()}
    raw = {layer + RAW_LAYER: one.raw for layer, one in found.items() if one.raw is not None}
    return found | raw


def _groups_header(irradiance: Irradiance) -> dict[str, object]:
    """What the header says of each light group."""
    groups = dict[str, object]()
    for name, light in irradiance.groups.items():
        known = light.rendered_for
        if known is None:
            illuminant = None
        else:
            illuminant = known.to_dict()["illuminant"]
        if light.raw is None:
            raw = None
        else:
            raw = light.raw.statistics.to_dict()
        statistics = light.statistics.to_dict()
        groups[name] = {"statistics": statistics, "raw": raw, "illuminant": illuminant}
    return groups


def _half_scale(arrays: list[np.ndarray]) -> float:
    """The power of two at which no finite number of the arrays is beyond half precision."""
    most = max(float(np.max(array, initial=0.0, where=np.isfinite(array))) for array in arrays)
    if not most > 0:
        return 1.0
    power = np.floor(np.log2(MOST_HALF / most))
    return float(2.0 ** min(power, MOST_POWER))


def read_irradiance_exr(path: str | os.PathLike[str]) -> Irradiance:
    """Light of a file that :func:`write_irradiance_exr` wrote.

    Raises InputError for anything else: no such file, not an EXR, no spectrum in it, cut short.
    """
    wrong = "but not the focal-plane irradiance that `mitsuba-sensor render` writes"
    with whole_exr(Path(path), wrong, "; give an irradiance.exr") as (header, pixels):
        return _irradiance(header, pixels)


def _irradiance(header: Mapping[str, Any], pixels: Mapping[str, np.ndarray]) -> Irradiance:
    """Light of the header and the channels of an irradiance.exr. Raises ValueError and KeyError for other files."""
    from ..render.light.irradiance import Irradiance

    if "filters" in header:
        filters: tuple[str, ...] | None = _names_of(json_value(header["filters"]))
    else:
        filters = None
    if filters:
        names, prefix = list(filters), FILTER_CHANNEL
        lengths_nm = [header["reference_nm"]] * len(names)
    else:
        prefix = SPECTRAL_CHANNEL
        bands = [name for name in pixels if name.startswith(prefix)]
        names = [name.removeprefix(prefix) for name in bands]
        names.sort(key=_wavelength_nm)  # EXR sorts them as text
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
        raw = Irradiance(**light(RAW_LAYER, _statistics(header["raw_statistics"])))
    rendered_for = _rendered_for(header)
    groups = dict[str, Irradiance]()
    for name, of_group in json_value(header.get("light_groups", "{}")).items():
        layer = f"{GROUP_LAYER}{name}."
        raw_group = None
        if of_group["raw"] is not None:
            raw_group = Irradiance(**light(layer + RAW_LAYER, _statistics_of(of_group["raw"])))
        groups[name] = Irradiance(
            **light(layer, _statistics_of(of_group["statistics"])),
            rendered_for=_with_illuminant(rendered_for, of_group["illuminant"]),
            raw=raw_group,
        )
    return Irradiance(
        **light("", _statistics(header["render_statistics"])),
        rendered_for=rendered_for,
        raw=raw,
        groups=groups,
        levels=dict.fromkeys(groups, 1.0),
    )


def _with_illuminant(known: RenderedFor | None, illuminant: object) -> RenderedFor | None:
    """What a light group was rendered for: as the whole light, with an illuminant of its own."""
    if known is None:
        return None
    return known.from_dict({**known.to_dict(), "illuminant": illuminant})


def _pair_of(value: object) -> tuple[int, int]:
    """Row and column in a header. Raises ValueError for anything else."""
    match value:
        case [int(row), int(column)]:
            return row, column
    raise ValueError(f"first_pixel is {shown(value)}")


def _widths_of(value: object, bands: int) -> np.ndarray:
    """Widths of so many bands in a header [nm]. Raises ValueError for anything else."""
    widths = np.array(value, dtype=float)
    if widths.shape != (bands,) or not np.isfinite(widths).all():
        raise ValueError(f"bandwidths_nm is {shown(value)}")
    return widths


def _names_of(value: object) -> tuple[str, ...]:
    """Names of filters in a header. Raises ValueError for anything else."""
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        raise ValueError(f"filters is {shown(value)}")
    return tuple(value)


def rendered_for(path: str | os.PathLike[str]) -> RenderedFor | None:
    """What an irradiance.exr was rendered for, without reading its pixels; None where it does not say.

    Raises InputError for what is no EXR.
    """
    with whole_exr(Path(path), "whose header cannot be read", pixels=False) as (header, _):
        return _rendered_for(header)


def _rendered_for(header: Mapping[str, Any]) -> RenderedFor | None:
    from ..render.light.irradiance import RenderedFor

    if "rendered_for" not in header:
        return None
    return RenderedFor.from_dict(json_value(header["rendered_for"]))


def _statistics(text: str) -> RenderStatistics:
    """Render statistics from JSON, whose notes are a tuple again."""
    return _statistics_of(json_value(text))


def _statistics_of(values: object) -> RenderStatistics:
    from ..render.light.statistics import RenderStatistics

    return RenderStatistics.from_dict(values)


def write_aovs_exr(path: Path, aovs: Aovs) -> None:
    """AOVs as float32 EXR, one layer for each of its arrays; :func:`read_aovs_exr` is its inverse.

    The header has ``units`` and ``shapes``, the names behind the numbers of ``shape_index``, as JSON.
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
    """AOVs of a file that :func:`write_aovs_exr` wrote. Raises InputError for anything else."""
    from ..render.motion.aovs import Aovs

    wrong = "without the AOVs that `render --aovs` writes"
    with whole_exr(Path(path), wrong) as (header, pixels):
        arrays: dict[str, np.ndarray] = {}
        for name, (axes, _) in AOV_LAYERS.items():
            images = [pixels[layer] for layer in _layers(name, axes)]
            arrays[name] = images[0]
            if len(images) > 1:
                arrays[name] = np.stack(images, axis=-1)
        return Aovs(
            **arrays,
            shapes=tuple(json_value(header["shapes"])),
            scene_sha256=header["scene_sha256"],
        )


def _layers(name: str, axes: str) -> list[str]:
    """Names of the EXR channels of one array."""
    return [f"{name}.{axis}" for axis in axes] or [name]


def _wavelength_nm(name: str) -> float:
    return float(name.removesuffix("nm").replace(",", "."))
