"""The only door to the disk: raw TIFF, preview PNG, spectral and truth EXR, JSON; each appears whole or not at all.

Every writer fills a temporary name in the same folder and renames it at the end, so a reader never meets half a file;
:func:`output_folder` does the same for a set of files. What the disk refuses becomes one sentence (InputError).
"""

from __future__ import annotations

import errno
import json
import os
import shutil
import tempfile
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..engine.errors import InputError

if TYPE_CHECKING:
    from ..light.irradiance import Irradiance
    from ..light.truth import GroundTruth

EXR_MAGIC = b"\x76\x2f\x31\x01"  # OpenEXR file layout, "Magic Number"
SPECTRAL_CHANNEL = "S0."  # Fichet, Pacanowski & Wilkie 2021, "An OpenEXR Layout for Spectral Images", JCGT 10(3)
FILTER_CHANNEL = "channel."
ERROR_CHANNEL = "standard_error."
RELATIVE_ERROR_CHANNEL = "relative_error"
TRUTH_LAYERS = {  # array of a GroundTruth → its components, its unit
    "depth_m": ("", "m along the optical axis, inf where nothing is"),
    "position_m": ("XYZ", "m in world space, NaN where nothing is"),
    "normal": ("XYZ", "unit vector in world space, 0 where nothing is"),
    "albedo": ("RGB", "mean diffuse reflectance over 600-700, 500-600, 400-500 nm"),
    "shape_index": ("", "number in shapes, from 0; -1 where nothing is"),
    "flow_px": ("XY", "pixels to the right and down during the exposure"),
}


@contextmanager
def output_folder(path: Path | str, names: Sequence[str]) -> Iterator[Path]:
    """Yield a scratch folder; when the block ends well, its files ``names`` appear in ``path``, all of them or none.

    Whatever goes wrong, Ctrl-C included, leaves older files in ``path`` as they were and removes what this call made.
    Raises InputError before the block runs if ``path`` cannot take the files.
    """
    folder = Path(path)
    made = _make_folder(folder)
    scratch: Path | None = None
    try:
        with disk_sentences(folder):
            _refuse_folders_in_the_way(folder, names)
            scratch = Path(tempfile.mkdtemp(prefix=".unfinished-", dir=folder))
        yield scratch
        with disk_sentences(folder):
            _publish(scratch, folder, [name for name in names if (scratch / name).exists()])
    except BaseException:
        _remove(scratch, made)
        raise
    _remove(scratch, [])


def write_tiff(path: Path, frames: np.ndarray) -> None:
    """Raw digital numbers (N, H, W), unsigned 8, 16 or 32 bit, one page per frame, nothing scaled."""
    import tifffile

    with _appearing(path) as temporary:
        tifffile.imwrite(temporary, frames, photometric="minisblack", metadata=None, software="mitsuba_sensor")


def write_png(path: Path, picture: np.ndarray) -> None:
    """An 8-bit picture for the eye, (H, W) grey or (H, W, 3) sRGB."""
    from PIL import Image

    with _appearing(path) as temporary:
        Image.fromarray(picture).save(temporary, format="PNG")


def write_json(path: Path, report: dict[str, Any]) -> None:
    """A report as strict JSON (see :func:`to_json`)."""
    with _appearing(path) as temporary:
        temporary.write_text(to_json(report) + "\n", encoding="utf-8")


def to_json(report: Any) -> str:
    """Indented strict JSON: NumPy values become plain ones, NaN and ±inf, which JSON does not have, become null."""
    return json.dumps(_plain(report), indent=2, ensure_ascii=False, allow_nan=False)


def write_patterns(path: Path, patterns: Mapping[str, np.ndarray]) -> None:
    """Fixed patterns by name as a NumPy .npz; :func:`read_patterns` is its inverse."""
    with _appearing(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **patterns)  # type: ignore[arg-type]


def read_patterns(path: Path) -> dict[str, np.ndarray]:
    """What :func:`write_patterns` wrote, or maps of a real sensor under the same names. Raises InputError."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {name: np.asarray(archive[name]) for name in archive.files}
    except (OSError, ValueError, AttributeError, TypeError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        why = getattr(error, "strerror", None) or "it is no .npz of numbers"
        raise InputError(
            f"the patterns {path} cannot be read: {why}; make one with `mitsuba-sensor patterns`."
        ) from None


def write_irradiance_exr(path: Path, irradiance: Irradiance) -> None:
    """Focal-plane irradiance [W m⁻² nm⁻¹] as float32 spectral EXR; :func:`read_irradiance_exr` is its inverse.

    Channels ``S0.<nm>nm`` hold the bands and ``standard_error.<nm>nm`` their standard errors in the same unit (decimal
    comma, as Fichet et al. 2021 have it, because a dot separates layers); ``relative_error`` that of the electrons.
    What was rendered into colour filters has ``channel.<filter>`` instead, in W m⁻² at the wavelength in the header.
    """
    header = {
        "spectralLayoutVersion": "1.0",
        "polarisationHandedness": "right",
        "emissiveUnits": "W.m^-2.nm^-1",
        "bandwidths_nm": json.dumps([float(width) for width in irradiance.bandwidths_nm]),
        "certificate": json.dumps(irradiance.certificate.to_dict(), default=_plain),
    }
    header["first_pixel"] = json.dumps(irradiance.origin)
    if irradiance.filters is not None:
        header |= {"filters": json.dumps(irradiance.filters), "response": irradiance.response}
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


def read_irradiance_exr(path: Path | str) -> Irradiance:
    """What :func:`write_irradiance_exr` wrote.

    Raises InputError for anything else: no such file, not an EXR, no spectrum in it, cut short.
    """
    from ..light.certificate import Certificate
    from ..light.irradiance import Irradiance

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
            certificate=_rebuilt(Certificate, json.loads(header["certificate"])),
            filters=filters,
            response=header.get("response"),
            origin=tuple(json.loads(header.get("first_pixel", "[0, 0]"))),
        )
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(
            f"{path} is an EXR but not the focal-plane irradiance that `mitsuba-sensor render` writes "
            f"(missing or unreadable: {error}); give an irradiance.exr."
        ) from error


def write_truth_exr(path: Path, truth: GroundTruth) -> None:
    """Ground truth as float32 EXR, one layer for each of its arrays; :func:`read_truth_exr` is its inverse.

    The header has ``units`` and ``shapes``, the names behind the numbers of ``shape_index``, as JSON.
    """
    header = {
        "units": json.dumps({name: unit for name, (_, unit) in TRUTH_LAYERS.items()}),
        "shapes": json.dumps(truth.shapes),
        "scene_sha256": truth.scene_sha256,
    }
    channels = {}
    for name, (axes, _) in TRUTH_LAYERS.items():
        image = np.atleast_3d(getattr(truth, name))
        channels |= {layer: _float32(image[..., k]) for k, layer in enumerate(_layers(name, axes))}
    _write_exr(path, header, channels)


def read_truth_exr(path: Path | str) -> GroundTruth:
    """What :func:`write_truth_exr` wrote. Raises InputError for anything else."""
    from ..light.truth import GroundTruth

    header, pixels = _whole_exr(Path(path))
    try:
        arrays = {
            name: np.stack([pixels[layer] for layer in _layers(name, axes)], axis=-1) if axes else pixels[name]
            for name, (axes, _) in TRUTH_LAYERS.items()
        }
        return GroundTruth(**arrays, shapes=tuple(json.loads(header["shapes"])), scene_sha256=header["scene_sha256"])
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(f"{path} is an EXR but no ground truth (missing or unreadable: {error}).") from error


@contextmanager
def disk_sentences(target: Path) -> Iterator[None]:
    """Turn what the operating system refuses into one sentence that names ``target``."""
    try:
        yield
    except OSError as error:
        why = error.strerror or str(error)
        raise InputError(f"cannot write {target}: {why}; give -o a place that has room and lets you write.") from error


@contextmanager
def _appearing(path: Path) -> Iterator[Path]:
    """A temporary name beside ``path`` that becomes ``path`` when the block ends well, and vanishes when not."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with disk_sentences(path):
            yield temporary
            os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def _make_folder(folder: Path) -> list[Path]:
    """Make ``folder`` and its parents; the ones that were not there, deepest first."""
    missing = [place for place in (folder, *folder.parents) if not os.path.lexists(place)]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise InputError(f"cannot write into {folder}: a file stands in its place; give -o another folder.") from error
    except OSError as error:
        raise InputError(f"cannot make the folder {folder}: {error.strerror}; give -o another place.") from error
    return missing


def _refuse_folders_in_the_way(folder: Path, names: Sequence[str]) -> None:
    for name in names:
        if (folder / name).is_dir():
            raise InputError(f"{folder / name} is a folder where a file should go; give -o another place.")


def _publish(scratch: Path, folder: Path, names: Sequence[str]) -> None:
    """Rename every file from ``scratch`` into ``folder``; on any failure put back what stood there."""
    older = scratch / "older"
    older.mkdir()
    begun: list[str] = []
    try:
        for name in names:
            if (folder / name).exists():
                os.replace(folder / name, older / name)
            begun.append(name)
            os.replace(scratch / name, folder / name)
    except BaseException:
        for name in reversed(begun):
            (folder / name).unlink(missing_ok=True)
            if (older / name).exists():
                os.replace(older / name, folder / name)
        raise


def _remove(scratch: Path | None, made: Sequence[Path]) -> None:
    """Remove the scratch folder, then the folders this job made, as far as they are empty."""
    if scratch is not None:
        shutil.rmtree(scratch, ignore_errors=True)
    for place in made:
        try:
            place.rmdir()
        except OSError:
            return


def _plain(value: Any) -> Any:
    """``value`` in the six types of JSON."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return str(value) if isinstance(value, Path) else value


def _float32(image: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(image, dtype=np.float32)


def _write_exr(path: Path, header: dict[str, Any], channels: dict[str, np.ndarray]) -> None:
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **header}
    with _appearing(path) as temporary:
        try:
            with OpenEXR.File(header, channels) as file:
                file.write(str(temporary))
        except (RuntimeError, ValueError) as error:  # its words for everything
            raise OSError(str(error)) from error
        if temporary.stat().st_size == 0:  # a file below 4 kB meets a full disk without a word
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _whole_exr(path: Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header and channels of an EXR; InputError if it is not there, not an EXR or not whole."""
    import OpenEXR

    _require_exr(path)
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            return dict(file.header()), {name: channel.pixels for name, channel in file.channels().items()}
    except (RuntimeError, ValueError) as error:
        raise InputError(f"{path} cannot be read as an OpenEXR file ({error}); render it again.") from error


def _layers(name: str, axes: str) -> list[str]:
    """Names of the EXR channels of one array."""
    return [f"{name}.{axis}" for axis in axes] or [name]


def _require_exr(path: Path) -> None:
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
