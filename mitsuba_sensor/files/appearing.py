"""Writers of TIFF, PNG, JSON, text and FPN maps; each file appears whole or not at all.

Every writer fills a temporary name in the same folder and renames it at the end, so nobody reads half a file;
:func:`output_folder` does the same for a set of files. What the disk refuses becomes one sentence (InputError).
"""

from __future__ import annotations

import io
import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from ..core import InputError, refuse_masked
from ..core.printable import printable_json
from ..core.small_files import require_small, toml_tables
from ..stopping import note_written, undone_if_stopped, whole_step
from .disk_errors import disk_sentences, names_in
from .plausible import read_arrays

NOTHING: Mapping[str, Any] = {}
TIFF_TYPES = "uint8", "uint16", "uint32", "float32"
TiffTag: TypeAlias = tuple[int, int, int, Any, bool]  # code, type, count, value, on the first page only
LARGEST_TIFF = 2**32 - 2**25
"""Bytes of pixels; more become a BigTIFF."""
CFA_COLOURS = "rgb"  # numbers 0, 1, 2 in the CFAPattern of TIFF/EP
TIFF_BYTE, TIFF_SHORT, TIFF_LONG = 1, 3, 4  # types of tags


@contextmanager
def output_folder(path: Path | str, names: Sequence[str]) -> Iterator[Path]:
    """Yield a scratch folder; when the block ends well, its files ``names`` appear in ``path``, all of them or none.

    names : of files; one with a ``*`` stands for all files that match it.
    Those of ``names`` that the block did not write are of an older run and no longer stay there.
    Whatever goes wrong, Ctrl-C included, leaves older files in ``path`` as they were and removes what this call made.
    Raises InputError before the block runs if ``path`` cannot take the files.
    """
    refuse_empty(path, "-o", "give the name of a folder, e.g. -o out")
    folder = Path(path)
    with ExitStack() as stack:
        with whole_step:
            made = _make_folder(folder)
            stack.enter_context(undone_if_stopped(partial(_remove_empty, made)))
        try:
            with disk_sentences(folder), whole_step:
                for name in _matching(names, folder):
                    if (folder / name).is_dir():
                        raise InputError(f"{folder / name} is a folder where a file should go; give another place.")
                scratch = tempfile.TemporaryDirectory(prefix=".unfinished-", dir=folder, ignore_cleanup_errors=True)
                stack.enter_context(undone_if_stopped(partial(shutil.rmtree, scratch.name)))
            with scratch:
                with names_in(folder, Path(scratch.name)):
                    yield Path(scratch.name)
                with disk_sentences(folder), whole_step:
                    _publish(Path(scratch.name), folder, _matching(names, folder, Path(scratch.name)))
        except BaseException:
            _remove_empty(made)
            raise


def write_tiff(path: str | os.PathLike[str], frames: np.ndarray, facts: Mapping[str, Any] = NOTHING) -> None:
    """Raw digital numbers (N, H, W), unsigned 8, 16 or 32 bit or float32, one page per frame, nothing scaled.

    Raises InputError for any other array, and for what the disk refuses.
    facts : ``image`` of frame.json; as JSON in the description, and black level, white level and the pattern of red,
        green and blue filters in the tags of TIFF/EP and DNG too.
    """
    refuse_masked("frames", frames)
    if not isinstance(frames, np.ndarray) or str(frames.dtype) not in TIFF_TYPES or frames.ndim not in (2, 3):
        given = f"{getattr(frames, 'dtype', type(frames).__name__)} of shape {getattr(frames, 'shape', ())}"
        raise InputError(f"frames is {given}; pass (H, W) or (N, H, W) of {', '.join(TIFF_TYPES)}.")
    if not frames.size:
        raise InputError(f"frames has shape {frames.shape} and no pixel; pass at least one.")
    tags = _raw_tags(facts) if facts else []
    text = to_json(dict(facts)).encode() if facts else None
    with appearing(Path(path), frames.nbytes) as temporary:
        write_pages(temporary, frames, text, tags)


def write_pages(path: Path, frames: np.ndarray, text: bytes | None, tags: Sequence[TiffTag]) -> None:
    """A TIFF of frames (H, W) or (N, H, W) with a description and tags. Raises OSError.

    Every byte passes through Python: NumPy's own way into a file (tofile) does not say when the disk has no place for
    the last ones.
    """
    import tifffile

    large = frames.nbytes > LARGEST_TIFF
    with (
        io.BufferedWriter(_NoTofile(path, "wb")) as file,
        tifffile.TiffWriter(file, bigtiff=large, byteorder="<") as tiff,
    ):
        for page in frames.reshape(-1, *frames.shape[-2:]):
            tiff.write(
                page,
                contiguous=True,
                photometric="minisblack",
                metadata=None,
                software="mitsuba_sensor",
                description=text,
                extratags=tags,
            )


class _NoTofile(io.FileIO):
    """A file to which NumPy does not write past Python."""

    def fileno(self) -> int:
        raise io.UnsupportedOperation


def _raw_tags(facts: Mapping[str, Any]) -> list[TiffTag]:
    """(code, type, count, value, first page only) of BlackLevel, WhiteLevel, CFARepeatPatternDim and CFAPattern."""
    tags: list[TiffTag] = [
        (50714, TIFF_LONG, 1, round(facts["black_level_dn"]), False),
        (50717, TIFF_LONG, 1, facts["white_level_dn"], False),
    ]
    return [*tags, *cfa_tags(facts["cfa_pattern"])]


def cfa_tags(pattern: Sequence[Sequence[str]] | None) -> list[TiffTag]:
    """CFARepeatPatternDim and CFAPattern of rows of filter names, if all of them are red, green or blue."""
    names = np.array(pattern or [[]])
    initials = [name[:1].lower() for name in names.ravel()]
    if not initials or not set(initials) <= set(CFA_COLOURS):
        return []
    colours = bytes(CFA_COLOURS.index(one) for one in initials)
    return [(33421, TIFF_SHORT, 2, names.shape, False), (33422, TIFF_BYTE, names.size, colours, False)]


def write_png(path: Path, picture: np.ndarray, facts: Mapping[str, Any] = NOTHING) -> None:
    """An 8-bit preview, (H, W) grey or (H, W, 3) sRGB.  facts : what becomes text in it, each value as JSON."""
    write_drawing(path, png(picture, facts))


def png(picture: np.ndarray, facts: Mapping[str, Any] = NOTHING) -> bytes:
    """The same as the bytes of a file."""
    from PIL import Image, PngImagePlugin

    texts, content = PngImagePlugin.PngInfo(), io.BytesIO()
    for name, value in facts.items():
        texts.add_text(name, json.dumps(plain_values(value)))
    Image.fromarray(picture).save(content, format="PNG", pnginfo=texts)
    return content.getvalue()


def write_page(path: Path, text: str) -> None:
    """Text in UTF-8, an HTML page for example."""
    write_drawing(path, text.encode())


def write_drawing(path: Path, content: bytes) -> None:
    """A file that is already made, a drawn PNG for example."""
    with appearing(path, len(content)) as temporary:
        temporary.write_bytes(content)


def write_json(path: Path, report: dict[str, Any]) -> None:
    """A report as strict JSON (see :func:`to_json`)."""
    write_page(path, to_json(report) + "\n")


def to_json(report: Any) -> str:
    """Indented strict JSON: NumPy values become plain ones, NaN and ±inf, which JSON does not have, become null."""
    return printable_json(json.dumps(plain_values(report), indent=2, ensure_ascii=False, allow_nan=False))


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file. Raises OSError, UnicodeDecodeError or TOMLDecodeError."""
    require_small(path, "the file")
    return toml_tables(path.read_text("utf-8"))


def write_fpn_maps(path: Path, maps: Mapping[str, np.ndarray]) -> None:
    """FPN maps by name as a NumPy .npz; :func:`read_fpn_maps` is its inverse."""
    size = sum(values.nbytes for values in maps.values())
    with appearing(path, size) as temporary, temporary.open("wb") as file:
        np.savez(file, **maps)  # type: ignore[arg-type]


def read_fpn_maps(path: Path) -> dict[str, np.ndarray]:
    """What :func:`write_fpn_maps` wrote, or maps of a real sensor under the same names. Raises InputError."""
    try:
        return read_arrays(Path(path))
    except InputError:
        raise
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or "it is no .npz of numbers"
        raise InputError(
            f"the FPN maps {path} cannot be read: {why}; make one with `mitsuba-sensor fpn-maps`."
        ) from None


def refuse_empty(path: Path | str, name: str, remedy: str) -> None:
    """Raise InputError for an empty path, which would be the current folder. name : of the option."""
    if not os.fspath(path):
        raise InputError(f"{name} is empty; {remedy}.")


def require_folder(path: Path | str) -> None:
    """Raise InputError if ``path`` can be no folder, before long work; nothing is made."""
    refuse_empty(path, "-o", "give the name of a folder, e.g. -o out")
    nearest = next(place for place in (Path(path), *Path(path).absolute().parents) if os.path.lexists(place))
    if not nearest.is_dir():
        raise InputError(f"cannot write into {path}: a file stands in its place; give another folder.")
    if not os.access(nearest, os.W_OK):
        raise InputError(f"cannot make the folder {path}: {nearest} cannot be written; give another place.")


@contextmanager
def appearing(path: Path, size: int | None = None) -> Iterator[Path]:
    """A temporary name beside ``path`` that becomes ``path`` when the block ends well, and vanishes when not.

    size : of the file, for the error that a full disk is [bytes].
    """
    if not path.name:
        raise InputError(f"cannot write {path}: that is a folder; give the name of a file.")
    if not os.path.lexists(path.parent):
        raise InputError(f"cannot write {path}: there is no folder {path.parent}; make it, or give another name.")
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with disk_sentences(path, size), undone_if_stopped(temporary.unlink):
            yield temporary
            with whole_step:
                os.replace(temporary, path)
                note_written(path)
    finally:
        with suppress(OSError):  # a file stands where the folder should be: said already
            temporary.unlink(missing_ok=True)


def _make_folder(folder: Path) -> list[Path]:
    """Make ``folder`` and its parents; the ones that were not there, deepest first."""
    missing = [place for place in (folder, *folder.parents) if not os.path.lexists(place)]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise InputError(f"cannot write into {folder}: a file stands in its place; give another folder.") from error
    except OSError as error:
        raise InputError(f"cannot make the folder {folder}: {error.strerror}; give another place.") from error
    return missing


def _remove_empty(folders: Sequence[Path]) -> None:
    """Remove the folders; one that is not empty stays, and those above it."""
    with suppress(OSError):
        for folder in folders:
            folder.rmdir()


def _matching(names: Sequence[str], *folders: Path) -> list[str]:
    """The names, with those of the files in these folders in the place of a pattern."""
    found: list[str] = []
    for name in names:
        found += sorted({path.name for folder in folders for path in folder.glob(name)}) if "*" in name else [name]
    return found


def _publish(scratch: Path, folder: Path, names: Sequence[str]) -> None:
    """Rename these files from ``scratch`` into ``folder``, in the place of what stood there; on any failure put that
    back."""
    older, appeared = scratch / "older", [name for name in names if (scratch / name).exists()]
    older.mkdir()
    try:
        for name in names:
            if os.path.lexists(folder / name):
                os.replace(folder / name, older / name)
            if name in appeared:
                os.replace(scratch / name, folder / name)
    except BaseException:
        for name in names:
            if os.path.lexists(older / name):
                os.replace(older / name, folder / name)
            elif name in appeared and not (scratch / name).exists():
                (folder / name).unlink(missing_ok=True)
        raise
    for name in appeared:
        note_written(folder / name)


def plain_values(value: Any, finite: bool = True) -> Any:
    """``value`` in the six types of JSON; NaN and ±inf are null where they must be ``finite``."""
    if isinstance(value, dict):
        return {str(key): plain_values(item, finite) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain_values(item, finite) for item in value]
    if isinstance(value, np.generic):
        return plain_values(value.item(), finite)
    if isinstance(value, float):
        return value if np.isfinite(value) or not finite else None
    return str(value) if isinstance(value, Path) else value
