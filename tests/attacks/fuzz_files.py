"""Reads thousands of damaged files of every kind that is read: each is accepted, or refused in one sentence.

    python tests/attacks/fuzz_files.py --cases 5000

A case is a right file of this repository with changed bytes, values, names or tags, made by its number alone; or one
of whose fields has a value of another type. Each is read in another process. A fault is any exception but InputError, a
refusal that is not one line, a value that was ignored or changed in silence, a case that takes more than 20 s or 1 GB,
and one that ends the process.
"""

from __future__ import annotations

import argparse
import copy
import json
import logging
import math
import random
import re
import resource
import shutil
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple
from xml.sax.saxutils import escape

import numpy as np
import tifffile
from PIL import Image

import mitsuba_sensor as ms
from mitsuba_sensor.core.signals import Illuminant
from mitsuba_sensor.dataset.file import read_dataset
from mitsuba_sensor.dataset.plan import load_plan
from mitsuba_sensor.files.npz import read_fpn_maps
from mitsuba_sensor.files.openexr import Plane, whole_exr, write_planes
from mitsuba_sensor.files.raw_files import read_raw
from mitsuba_sensor.files.scene_references import scene_references
from mitsuba_sensor.lab.frames.bench import read_bench
from mitsuba_sensor.output.exr import rendered_for, write_irradiance_exr
from mitsuba_sensor.output.importers.import_camera import import_camera
from mitsuba_sensor.render.light.irradiance import Irradiance, RenderedFor
from mitsuba_sensor.render.light.photons import collect
from mitsuba_sensor.render.light.statistics import RenderStatistics
from mitsuba_sensor.render.load.scene import inspect_scene
from mitsuba_sensor.render.scene.motion import read_motion
from mitsuba_sensor.render.scene.parse_scene import parse
from mitsuba_sensor.render.variants import choose_variant, use

SECONDS, KILOBYTES = 20.0, 2**20  # of one case
BATCH = 500  # cases of a process
ROOT = Path(__file__).resolve().parents[2]
KINDS = ("dataset", "camera", "motion", "scene", "lens", "curves", "pixels")
SUFFIXES = {"scene": ".xml", "lens": ".json", "curves": ".csv"}  # else .toml
LONGEST = 1500  # characters of a sentence
TOKEN = re.compile(r'"[^"\n]*"|[\w.+-]+|[^\s\w]')
"""A quoted text, a word or number, or another character of a text."""
DATA = Path(__file__).parents[1] / "data" / "fuzz"
VALUES = json.loads((DATA / "values.json").read_text("utf-8"))
"""Texts that replace a value."""
TABLES: dict[str, Any] = json.loads((DATA / "tables.json").read_text("utf-8"))
"""Kind of file → valid content."""
MOTION, POSES, DATASET = (
    (DATA / f"{name}.toml").read_text("utf-8") for name in ("motion", "poses", "dataset")
)


def sources(kind: str) -> list[str]:
    """Texts of right files of a kind, which cases damage."""
    folders = {
        "camera": ROOT / "mitsuba_sensor" / "camera" / "cameras",
        "scene": ROOT / "scenes",
    }
    if kind == "dataset":
        examples = (
            path.read_text("utf-8") for path in sorted((ROOT / "examples").glob("*.toml"))
        )
        return [DATASET, *(text for text in examples if "[[cameras]]" in text)]
    if kind == "motion":
        return [MOTION, POSES, (ROOT / "scenes" / "rolling_fan.toml").read_text("utf-8")]
    if kind == "curves":
        return [
            "wavelength_nm,R_percent,G_percent\n400,1,2\n500,40,50.5\n600,60,30\n700,10,5\n"
        ]
    if kind == "lens":
        return [
            path.read_text("utf-8")
            for path in sorted((ROOT / "mitsuba_sensor/camera/lenses").glob("*.json"))
        ]
    pattern = "*.toml" if kind == "camera" else "*.xml"
    return [path.read_text("utf-8") for path in sorted(folders[kind].glob(pattern))]


@cache
def pixel_files() -> list[tuple[str, bytes]]:
    """(suffix, content) of right files of arrays: OpenEXR, TIFF, DNG, PNG, NumPy."""
    frame = np.random.default_rng(1).integers(0, 4096, (8, 12), dtype=np.uint16)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_planes(
            folder / "a.exr",
            {},
            {f"S0.{nm},0nm": Plane(frame.astype(np.float32)) for nm in (500, 600)},
        )
        ms.write_tiff(folder / "a.tiff", frame)
        tifffile.imwrite(folder / "b.tiff", frame, compression="zlib")
        Image.fromarray(frame).save(folder / "a.png")
        np.save(folder / "a.npy", frame)
        np.savez(folder / "a.npz", prnu=frame.astype(float))
        np.savez_compressed(folder / "b.npz", prnu=frame.astype(float))
        photons = ms.Photons(np.full((24, 24, 1), 500.0), np.array([550.0]))
        ms.expose(photons, ms.load_camera("konnik_table1"), ms.Exposure(0.01)).save_dng(
            folder / "a.dng"
        )
        return [(path.suffix, path.read_bytes()) for path in sorted(folder.iterdir())]


def damaged(kind: str, number: int) -> tuple[str, bytes]:
    """Suffix and content of the file of a number: bytes or single values and names are changed, one to four times."""
    draw = random.Random(f"{kind}/{number}")
    if kind == "pixels":
        suffix, content = draw.choice(pixel_files())
        return suffix, _with_wrong_bytes(content, draw)
    return SUFFIXES.get(kind, ".toml"), _damaged_text(kind, draw)


def _damaged_text(kind: str, draw: random.Random) -> bytes:
    text = draw.choice(sources(kind))
    if draw.random() < 0.35:
        return _with_wrong_bytes(text.encode(), draw)
    for _ in range(draw.choice((1, 1, 1, 2, 4))):
        text = _with_wrong_token(text, draw)
    return text.encode("utf-8", "surrogatepass")


def _with_wrong_bytes(content: bytes, draw: random.Random) -> bytes:
    """Bits flipped; parts cut out, doubled, moved; bytes from nowhere; an end that is missing."""
    data = bytearray(content)
    for _ in range(draw.choice((1, 1, 2, 5, 50))):
        start = draw.randrange(len(data) or 1)
        end = min(start + draw.choice((1, 2, 10, 200)), len(data))
        how = draw.randrange(6)
        if how == 0 and data:
            data[start] ^= 1 << draw.randrange(8)
        elif how == 1:
            del data[start:end]
        elif how == 2:
            data[start:start] = data[start:end] * draw.choice((1, 30))
        elif how == 3:
            data[start:start] = draw.randbytes(draw.choice((1, 4, 40)))
        elif how == 4:
            data[start:start] = draw.choice(b"\x00 \" ] [[ < /> <!-- & ''' \xff\xfe =".split())
        elif draw.random() < 0.2:
            del data[start:]
    return bytes(data)


def _with_wrong_token(text: str, draw: random.Random) -> str:
    """Change a word, number or quoted text: misspell, replace or scale it; or delete or repeat a line."""
    how, lines = draw.randrange(7), text.splitlines()
    if how < 2:
        place = draw.randrange(len(lines) or 1)
        lines[place : place + 1] = lines[place : place + 1] * (2 * how)
        return "\n".join(lines) + "\n"
    token = draw.choice([*TOKEN.finditer(text)] or [None])
    if token is None:
        return text
    old = token[0].strip('"')
    if how == 2 and re.fullmatch(r"-?\d+(\.\d+)?(e-?\d+)?", old):
        new = repr(float(old) * draw.choice((-1, 0, 1e-3, 1e3, 1e6, 1e-30, 1e30, 1.1)))
    else:
        new = misspelt(old, draw) if how < 5 else draw.choice(VALUES)
    quote = '"' if token[0][0] == '"' and how != 6 else ""
    return f"{text[: token.start()]}{quote}{new}{quote}{text[token.end() :]}"


def misspelt(name: str, draw: random.Random) -> str:
    """One letter is missing, double, another one or has changed places."""
    k = draw.randrange(len(name)) if name else 0
    kinds = (
        name[:k] + name[k + 1 :],
        name[:k] + name[k : k + 1] + name[k:],
        name[:k] + "x" + name[k + 1 :],
    )
    return draw.choice(
        (*kinds, name[:k] + name[k + 1 : k + 2] + name[k : k + 1] + name[k + 2 :])
    )


def _read_dataset(path: Path) -> str:
    file = read_dataset(path)
    for _, _view in zip(range(2), load_plan(path, [ROOT]).tasks(), strict=False):
        pass
    return ignored(tomllib.loads(path.read_text("utf-8")), file.model_dump(mode="python"))


def _read_camera(path: Path) -> str:
    camera = ms.load_camera(path)
    said = ignored(tomllib.loads(path.read_text("utf-8")), camera.model_dump(mode="python"))
    photons = ms.Photons(np.full((4, 6, 1), 500.0), np.array([550.0]))
    frames = ms.expose(photons, camera, ms.Exposure(0.01), frames=1)
    top = int(frames.digital.max())
    return said or (
        "" if top < 2**camera.adc.bits else f"a frame has {top} DN of {camera.adc.bits} bits"
    )


def _read_motion(path: Path) -> str:
    motion = read_motion(path)
    moved = [motion.camera] if motion.camera else []
    for one in (*moved, *motion.objects.values()):
        for time_s in (0.0, 0.013, 1e3):
            if not np.isfinite(one.displacement(time_s, np.eye(4))).all():
                return f"a displacement after {time_s} s is not finite"
    return ignored(tomllib.loads(path.read_text("utf-8")), motion.model_dump(mode="python"))


def _read_scene(path: Path) -> str:
    use(choose_variant("scalar_spectral"))
    scene_references(path, {}, [path.parent, ROOT])
    scene = parse(path, {})
    inspect_scene(scene, scene.settings.camera or ms.load_camera("konnik_table1"), {})
    return ""


def _read_lens(path: Path) -> str:
    ms.load_camera("konnik_table1").replace(
        **{"lens.prescription": str(path), "lens.focal_length_mm": 25.0}
    )
    return ""


def _read_curves(path: Path) -> str:
    camera = ms.load_camera("bayer_2mp").replace(
        quantum_efficiency={"file": str(path), "tile": [["R", "G"]], "reference_nm": 550}
    )
    values = np.array([*camera.quantum_efficiency.curves.values()])
    return (
        ""
        if ((values >= 0) & (values <= 1)).all()
        else "a quantum efficiency is not within 0 and 1"
    )


def _read_pixels(path: Path) -> str:
    if path.suffix == ".exr":
        ms.read_irradiance(path, unit="w_per_m2_nm")
    elif path.suffix == ".npz":
        read_fpn_maps(path)
    else:
        read_raw(path).frames.sum()
    return ""


READERS = {
    "dataset": _read_dataset,
    "camera": _read_camera,
    "motion": _read_motion,
    "scene": _read_scene,
}
READERS |= {"lens": _read_lens, "curves": _read_curves, "pixels": _read_pixels}


def ignored(given: Any, accepted: Any, place: str = "") -> str:
    """A value of a TOML file that what was read does not have under its name: ignored or changed in silence."""
    if isinstance(given, Mapping):
        for name, value in given.items():
            if not isinstance(accepted, Mapping) or name not in accepted:
                return f"{place}{name} is not in what was read"
            if said := ignored(value, accepted[name], f"{place}{name}."):
                return said
        return ""
    if isinstance(given, list) and isinstance(accepted, list | tuple):
        pairs = enumerate(zip(given, accepted, strict=len(given) == len(accepted)))
        return next(
            (said for k, (a, b) in pairs if (said := ignored(a, b, f"{place}{k}."))), ""
        )
    same = (
        given == accepted
        or (isinstance(given, float) and not math.isfinite(given))
        or str(given) == str(accepted)
    )
    finite = not isinstance(accepted, float) or math.isfinite(accepted)
    return (
        ""
        if same and finite
        else f"{place[:-1]} is {str(given)[:60]!r} and was read as {str(accepted)[:60]!r}"
    )


def sentences_wrong(said: str) -> str:
    """What is wrong with a refusal: it must be one line of plain text."""
    if any(ord(letter) < 32 or ord(letter) == 127 for letter in said):
        return "has a control character or a line break"
    if not said.rstrip().endswith((".", "?", ")")):
        return "does not end like a sentence"
    if len(said) > LONGEST:
        return f"has {len(said)} characters"
    return next(
        (
            f"says {text!r}"
            for text in ("Traceback", "pydantic", "errors.pydantic", "0x7f")
            if text in said
        ),
        "",
    )


Place = tuple[str | int, ...]
DEEP: Any = 0
for _ in range(60):
    DEEP = [DEEP]
TYPES: dict[str, Any] = {
    "null": None,
    "true": True,
    "zero": 0,
    "negative": -3,
    "huge": 10**400,
    "hexadecimal of many digits": 16**5000,
    "large": 1e308,
    "tiny": 5e-324,
    "nan": math.nan,
    "infinite": -math.inf,
    "no text": "",
    "text": "x",
    "long text": "long " * 2000,
    "control characters": "\x1b[31m\x9b2J\u202e\x00\n",
    "no list": [],
    "list": [1],
    "list of texts": ["a", "b"],
    "nested list": [[1, [2]]],
    "no table": {},
    "table": {"a": 1},
    "nested table": {"data": {"data": [1, {"b": None}]}},
    "deep": DEEP,
}
"""By name. TOML has no null: there the field is left out."""


def toml_value(value: Any) -> str:
    """A value as TOML writes it inline."""
    if isinstance(value, dict):
        pairs = (
            f"{json.dumps(str(name))} = {toml_value(x)}"
            for name, x in value.items()
            if x is not None
        )
        return f"{{{', '.join(pairs)}}}"
    if isinstance(value, list):
        return f"[{', '.join(toml_value(x) for x in value if x is not None)}]"
    if isinstance(value, str):
        return json.dumps(value).replace("\x7f", "\\u007f")
    if isinstance(value, bool):
        return str(value).lower()
    return hex(value) if isinstance(value, int) and value > 10**300 else str(value)


def toml(tables: dict[str, Any]) -> str:
    """Tables as the text of a file."""
    lines = (
        f"{json.dumps(name)} = {toml_value(x)}" for name, x in tables.items() if x is not None
    )
    return "\n".join(lines) + "\n"


def plain_json(value: Any) -> str:
    """JSON with NaN and Infinity, and whole numbers of any length."""
    sys.set_int_max_str_digits(0)
    try:
        return json.dumps(value)
    finally:
        sys.set_int_max_str_digits(4300)


def storage(tables: dict[str, Any]) -> str:
    """The XML of OpenCV."""
    return f'<?xml version="1.0"?><opencv_storage>{_elements(tables)}</opencv_storage>'


def emva_report(tables: dict[str, Any]) -> str:
    """The XML of emva1288."""
    return f"<report>{_elements(tables)}</report>"


def _elements(value: Any) -> str:
    if isinstance(value, dict):
        return "".join(f"<{name}>{_elements(x)}</{name}>" for name, x in value.items())
    if isinstance(value, list) and value and isinstance(value[0], dict | list):
        return "".join(f"<_>{_elements(x)}</_>" for x in value)
    if isinstance(value, list):
        return " ".join(map(plain_json, value))
    text = (
        ""
        if value is None
        else escape(plain_json(value) if not isinstance(value, str) else value)
    )
    return "".join(letter for letter in text if letter.isprintable())  # XML has no others


HEADERS = "bandwidths_nm", "first_pixel", "render_statistics", "rendered_for"


class Kind(NamedTuple):
    """A kind of file.  write : the tables into a file of that name.  read : the file; raises InputError."""

    name: str
    tables: Any
    write: Callable[[Path, Any], object]
    read: Callable[[Path], object]


def as_text(dump: Callable[[Any], str]) -> Callable[[Path, Any], object]:
    """Writes a text."""
    return lambda path, tables: path.write_text(dump(tables), "utf-8", "surrogatepass")


def write_described_tiff(path: Path, facts: Any) -> None:
    """A TIFF whose description has these facts, as ours do."""
    text = plain_json(facts).encode()
    tifffile.imwrite(path, np.ones((4, 6), np.uint16), description=text, metadata=None)


def write_fits(path: Path, cards: Any) -> None:
    """A FITS file with these cards; what FITS has no type for is left out."""
    from astropy.io import fits

    header = fits.Header()
    for name, given in cards.items():
        value = 2**62 if isinstance(given, int) and given > 2**62 else given
        try:
            header[name] = value
        except ValueError:
            continue
    fits.PrimaryHDU(np.ones((4, 6), np.int16), header).writeto(
        path, overwrite=True, output_verify="ignore"
    )


def light() -> Irradiance:
    """A small irradiance that knows what it was rendered for."""
    statistics = RenderStatistics(
        passes=2,
        samples_per_pixel=16,
        seconds=1.0,
        variant="scalar_spectral",
        sampler="multijitter",
        spectral="cube",
        noise_ratio_median=0.1,
        noise_ratio_p95=0.2,
        noise_ratio_max=0.3,
        noise_ratio_asked=None,
        ended_by="spp",
        reliable=True,
        firefly_fraction=0.0,
        negative=0,
        non_finite=0,
        notes=("a note",),
        scene_sha256="0" * 64,
        aperture_f_number=2.8,
        intrinsics={
            "matrix": np.eye(3).tolist(),
            "image_size": [8, 4],
            "distortion": [0.0] * 5,
            "heights_mm": None,
        },
        camera_to_world=np.eye(4).tolist(),
        metering={"key": 0.18},
    )
    cube, two = np.full((4, 8, 2), 1e-3, np.float32), np.array([500.0, 550.0])
    known = RenderedFor(
        ms.load_camera("konnik_table1"), ms.Exposure(0.01), 1, Illuminant(two, two)
    )
    error = np.full((4, 8), 0.1, np.float32)
    return Irradiance(
        cube, two, np.full(2, 50.0), 0.1 * cube, error, statistics, rendered_for=known
    )


@cache
def parts_of_light() -> tuple[dict[str, Any], dict[str, Plane]]:
    """Header and planes of its file; what is JSON in the header is a value."""
    with tempfile.TemporaryDirectory() as folder:
        write_irradiance_exr(Path(folder) / "a.exr", light())
        with whole_exr(Path(folder) / "a.exr", "of no use") as (header, images):
            plain = {name: x for name, x in header.items() if name in HEADERS}
            values = {
                name: json.loads(x) if isinstance(x, str) else x for name, x in plain.items()
            }
            return values, {name: Plane(x) for name, x in images.items()}


def write_light(path: Path, headers: Any) -> None:
    """An irradiance.exr with these headers."""
    texts = {name: plain_json(x) for name, x in headers.items()}
    write_planes(path, texts, parts_of_light()[1])


def read_light(path: Path) -> None:
    """The light, with what it says of itself; what it says must be of use."""
    given, known = ms.read_irradiance(path), rendered_for(path)
    assert known is None or isinstance(known.serial, int)
    json.dumps(given.statistics.to_dict())
    collect(given, ms.load_camera("konnik_table1"), ms.Exposure(0.01))


def read_frames(path: Path) -> str:
    """Raw frames, whose metadata are of their types or say nothing."""
    raw = read_raw(path)
    numbers = all(
        x is None or (type(x) is float and 0 <= x < math.inf)
        for x in (raw.exposure_s, raw.temperature_k)
    )
    texts = all(
        type(text) is str
        for text in (raw.gain, raw.kind, *(name for row in raw.tile for name in row))
    )
    return "" if numbers and texts else f"the metadata are {raw!r}"[:300]


def read_folder(path: Path) -> None:
    """A bench with its frames."""
    for name in ("dark0.tiff", "dark1.tiff", "flat.tiff"):
        tifffile.imwrite(path.with_name(name), np.full((2, 8, 8), 70, np.uint16), metadata=None)
    read_bench(path.parent)


@cache
def kinds() -> list[Kind]:
    """All of them."""
    lens = json.loads((ROOT / "mitsuba_sensor/camera/lenses/singlet.json").read_text("utf-8"))
    surface = {
        "radius": 10.0,
        "thickness": 1.0,
        "ior": 1.5,
        "semi_aperture": 5.0,
        "conic_constant": 0.0,
    }
    stop = {**surface, "radius": 0.0, "ior": 1.0}
    iset = {
        "name": "a",
        "description": "b",
        "surfaces": [stop, surface, {**surface, "radius": -10.0, "ior": 1.0}],
    }
    camera = tomllib.loads(
        (ROOT / "mitsuba_sensor/camera/cameras/bayer_2mp.toml").read_text("utf-8")
    )
    imported, text = import_camera, as_text(plain_json)
    return [
        Kind("camera.toml", camera, as_text(toml), ms.load_camera),
        Kind("checked.toml", camera, as_text(toml), ms.check_camera),
        Kind("dataset.toml", tomllib.loads(DATASET), as_text(toml), READERS["dataset"]),
        Kind("motion.toml", tomllib.loads(MOTION), as_text(toml), READERS["motion"]),
        Kind("poses.toml", tomllib.loads(POSES), as_text(toml), READERS["motion"]),
        Kind("lens.json", lens, text, READERS["lens"]),
        Kind("iset.json", iset, text, READERS["lens"]),
        Kind("transforms.json", TABLES["transforms"], text, imported),
        Kind("angles.json", TABLES["angles"], text, imported),
        Kind("tuning.json", TABLES["tuning"], text, imported),
        Kind("table.json", TABLES["noise_table"], text, imported),
        Kind("rows.json", [*TABLES["noise_table"].values()], text, imported),
        Kind("opencv.yml", TABLES["opencv"], text, imported),  # JSON is YAML
        Kind("ros.yaml", TABLES["ros"], text, imported),
        Kind("opencv.xml", TABLES["opencv"], as_text(storage), imported),
        Kind("ros.xml", TABLES["ros"], as_text(storage), imported),
        Kind("report.xml", TABLES["report"], as_text(emva_report), imported),
        Kind("preset.toml", TABLES["preset"], as_text(toml), imported),
        Kind("bench.toml", TABLES["bench"], as_text(toml), read_folder),
        Kind("described.tiff", TABLES["own_facts"], write_described_tiff, read_frames),
        Kind("frame.fits", TABLES["fits_cards"], write_fits, read_frames),
        Kind("light.exr", parts_of_light()[0], write_light, read_light),
    ]


def places(value: Any, place: Place = ()) -> Iterator[Place]:
    """Every field, and the whole; of a list the first and the last."""
    yield place
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from places(inner, (*place, name))
    elif isinstance(value, list):
        for number in sorted({0, len(value) - 1} if value else ()):
            yield from places(value[number], (*place, number))


def replaced(tables: Any, place: Place, value: Any) -> Any:
    """The tables with another value at a place."""
    if not place:
        return value
    changed = copy.deepcopy(tables)
    inner = changed
    for name in place[:-1]:
        inner = inner[name]
    inner[place[-1]] = value
    return changed


def examined(kind: str, number: int, folder: Path) -> tuple[str, str]:
    """("accepted" or "refused" or "fault", why) of the file of a number."""
    return examined_file(kind, *damaged(kind, number), folder)


def examined_file(kind: str, suffix: str, content: bytes, folder: Path) -> tuple[str, str]:
    """The same of one file."""
    path = folder / f"case{suffix}"
    path.write_bytes(content)
    if kind == "scene" and not (folder / "parts").exists():
        shutil.copytree(ROOT / "scenes" / "parts", folder / "parts")
    return judged(READERS[kind], path)


def examined_type(name: str, place: Place, value: str, folder: Path) -> tuple[str, str]:
    """The same of a file of that name with a value of another type at a place."""
    kind = next(kind for kind in kinds() if kind.name == name)
    tables = replaced(kind.tables, place, TYPES[value])
    if not isinstance(tables, dict) and not kind.name.endswith((".json", ".yml", ".yaml")):
        return "accepted", ""  # there is no such file
    kind.write(folder / name, tables)
    return judged(kind.read, folder / name)


def judged(read: Callable[[Path], object], path: Path) -> tuple[str, str]:
    """What reading a file comes to. A text that is returned says what was ignored."""
    try:
        said = read(path)
    except ms.InputError as error:
        wrong = sentences_wrong(str(error))
        text = str(error)[:400]
        return ("fault", f"the refusal {wrong}: {text!r}") if wrong else ("refused", text)
    except Exception as error:  # what this is for
        return "fault", f"{type(error).__name__}: {str(error)[:300]!r}"
    wrong = said if isinstance(said, str) else ""
    return ("fault", f"accepted, but {wrong}") if wrong else ("accepted", "")


def byte_cases(start: int, count: int) -> list[tuple[str, int]]:
    """(kind, number) of the cases, the kinds by turns."""
    return [(KINDS[number % len(KINDS)], number) for number in range(start, start + count)]


def type_cases() -> list[tuple[str, Place, str]]:
    """All of them, in an order of which any part represents the whole."""
    every = [
        (kind.name, place, value)
        for kind in kinds()
        for place in places(kind.tables)
        for value in TYPES
    ]
    random.Random(1).shuffle(every)
    return every


def in_process(case: tuple[Any, ...]) -> tuple[str, str]:
    """The result of a case, in a process that reads nothing else meanwhile."""
    logging.disable()  # tifffile tells of every tag
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with tempfile.TemporaryDirectory() as folder:
        examine = examined if len(case) == 2 else examined_type
        found = examine(*case, Path(folder))
    more = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    return ("fault", f"takes {more / 1e6:.1f} GB") if more > KILOBYTES else found


def report(cases: Sequence[tuple[Any, ...]]) -> tuple[Counter[tuple[str, str]], list[str]]:
    """How many of each kind of file are accepted and refused, and all faults."""
    from pebble import ProcessExpired, ProcessPool

    counts, faults = Counter[tuple[str, str]](), list[str]()
    with ProcessPool(1, max_tasks=BATCH, context=get_context("spawn")) as pool:
        futures = [pool.schedule(in_process, [case], timeout=SECONDS) for case in cases]
        for case, future in zip(cases, futures, strict=True):
            try:
                result, why = future.result()
            except TimeoutError:
                result, why = "fault", f"takes more than {SECONDS:g} s"
            except ProcessExpired as error:
                result, why = "fault", f"ends the process with {error.exitcode}"
            counts[case[0], result] += 1
            if result == "fault":
                faults.append(f"{case}: {why}")
                print(faults[-1], file=sys.stderr, flush=True)
    return counts, faults


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--cases", type=int, default=5000, help="half by bytes, half by types")
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    asked = parser.parse_args()
    first, half = asked.first, asked.cases // 2
    cases = [*byte_cases(first, half), *type_cases()[first : first + half]]
    counts, faults = report(cases)
    print("\n".join(f"{a} {b}: {n}" for (a, b), n in sorted(counts.items())))
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
