"""Damaged files of all kinds that are read, each made by its number, and what reading one of them says."""

from __future__ import annotations

import math
import random
import re
import shutil
import tempfile
import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from PIL import Image

import mitsuba_sensor as ms
from mitsuba_sensor.dataset.file import read_dataset
from mitsuba_sensor.dataset.plan import load_plan
from mitsuba_sensor.files.npz import read_fpn_maps
from mitsuba_sensor.files.openexr import Plane, write_planes
from mitsuba_sensor.files.raw_files import read_raw
from mitsuba_sensor.files.scene_references import scene_references
from mitsuba_sensor.render.load.scene import inspect_scene
from mitsuba_sensor.render.scene.motion import read_motion
from mitsuba_sensor.render.scene.parse_scene import parse
from mitsuba_sensor.render.variants import choose_variant, use

ROOT = Path(__file__).resolve().parents[2]
KINDS = ("dataset", "camera", "motion", "scene", "lens", "curves", "pixels")
SUFFIXES = {"scene": ".xml", "lens": ".json", "curves": ".csv"}  # else .toml
LONGEST = 1500  # characters of a sentence
LINE = re.compile(r'^(\s*)("[^"]+"|[\w.]+)(\s*=\s*)(.+)$', re.MULTILINE)
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e-?\d+)?")
ATTRIBUTE = re.compile(r'([\w-]+)="([^"]*)"')
VALUES = (
    "-1",
    "0",
    "1e308",
    "-1e-308",
    "nan",
    "inf",
    "-inf",
    "1e400",
    "9" * 400,
    "9" * 5000,
    "true",
    '""',
    '"x"',
    "[]",
)
VALUES += (
    "{}",
    "[[[]]]",
    '"\\u0000"',
    "1979-05-27",
    "[1, nan, 3]",
    '"../../../etc/passwd"',
    "-0.0",
    "[" * 200 + "]" * 200,
)
VALUES += (
    "2147483648",
    "18446744073709551616",
    "0.1",
    '["a", "b"]',
    "'''\n\n'''",
    '"none"',
    "1_000",
    "0x10",
)
TEXTS = (
    "",
    "-1",
    "nan",
    "1e400",
    "9" * 400,
    "../../../etc/passwd",
    "$none",
    "$",
    "a" * 5000,
    "\t",
    "0, 0, 0",
    "ä\U0001f600",
)
TEXTS += (
    "&#0;",
    "&amp;",
    "scene",
    "0",
    "1e-45",
    "2147483648",
    "true",
    "-2147483649",
    "plugins/x",
    "x.so",
    "perspective",
)
MOTION = """[camera]
axis = [0, 1, 0]
rotate_deg_per_s = 20
pivot_m = [0, 0, 0]
[[objects.ball.keys]]
time_s = 0
[[objects.ball.keys]]
time_s = 0.02
move_m = [0.1, 0, 0]
[[objects.fan.keys]]
time_s = 0.5
turn_deg = 30
axis = [0, 0, 1]
[objects.fan]
pivot_m = [0, 0.2, -1]
"""
POSES = """[[camera.keys]]
time_s = 0
origin_m = [0, 1, 4]
target_m = [0, 1, 0]
[[camera.keys]]
time_s = 0.1
to_world = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1]]
"""
DATASET = """name = "fuzz"
outputs = ["raw", "clean"]
[render]
spp = 16
width = 16
[[scenes]]
name = "one"
file = "scenes/cornell_box.xml"
parameters = {lamp_cd_per_m2 = 500}
views = [{origin_m = [0, 1, 3], target_m = [0, 1, 0]}]
[[scenes]]
name = "two"
file = "scenes/rolling_fan.xml"
motion = "scenes/rolling_fan.toml"
[[cameras]]
camera = "konnik_table1"
set = {"adc.bits" = 12}
without = ["prnu"]
[grid]
exposure_s = [0.001, 0.01]
[random]
draws = 3
values.temperature_k = {uniform = [280, 300]}
[splits]
shares = {train = 0.5, test = 0.5}
"""


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
    change = {
        "scene": _with_wrong_attribute,
        "lens": _with_wrong_field,
        "curves": _with_wrong_cell,
    }.get(kind, _with_wrong_line)
    for _ in range(draw.choice((1, 1, 1, 2, 4))):
        text = change(text, draw)
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
            data[start:start] = draw.choice(
                (
                    b"\x00",
                    b'"',
                    b"]",
                    b"[[",
                    b"<",
                    b"/>",
                    b"<!--",
                    b"&",
                    b"'''",
                    b"\xff\xfe",
                    b"=",
                )
            )
        elif draw.random() < 0.2:
            del data[start:]
    return bytes(data)


def _with_wrong_line(text: str, draw: random.Random) -> str:
    """One line ``key = value`` or one heading of TOML: another value, a misspelt key, no line, two of them."""
    lines = text.splitlines()
    places = [k for k, line in enumerate(lines) if LINE.match(line) or line.startswith("[")]
    if not places:
        return text
    place, how = draw.choice(places), draw.randrange(7)
    found = LINE.match(lines[place])
    if how == 0 and found:
        lines[place] = f"{found[1]}{misspelt(found[2], draw)}{found[3]}{found[4]}"
    elif how == 1:
        del lines[place]
    elif how == 2:
        lines.insert(draw.randrange(len(lines)), lines[place])
    elif found and how in (3, 4):
        lines[place] = f"{found[1]}{found[2]}{found[3]}{_with_wrong_number(found[4], draw)}"
    elif found:
        lines[place] = f"{found[1]}{found[2]}{found[3]}{draw.choice(VALUES)}"
    else:
        lines[place] = misspelt(lines[place], draw)
    return "\n".join(lines) + "\n"


def _with_wrong_attribute(text: str, draw: random.Random) -> str:
    """One attribute of XML: another value, a misspelt name or value; or a tag that is misspelt."""
    found = draw.choice(list(ATTRIBUTE.finditer(text)) or [None])  # type: ignore[list-item]
    if found is None:
        return text
    name, value, how = found[1], found[2], draw.randrange(4)
    if how == 0:
        name = misspelt(name, draw)
    elif how == 1:
        value = misspelt(value, draw)
    elif how == 2:
        value = draw.choice(TEXTS)
    else:
        tags = list(re.finditer(r"</?(\w+)", text))
        tag = draw.choice(tags)
        return text[: tag.start(1)] + misspelt(tag[1], draw) + text[tag.end(1) :]
    return f'{text[: found.start()]}{name}="{value}"{text[found.end() :]}'


def _with_wrong_number(value: str, draw: random.Random) -> str:
    """One number of a value times a factor."""
    numbers = list(NUMBER.finditer(value))
    if not numbers:
        return value
    one, factor = draw.choice(numbers), draw.choice((-1, 0, 1e-3, 1e3, 1e6, 1e-30, 1e30, 1.1))
    return f"{value[: one.start()]}{float(one[0]) * factor!r}{value[one.end() :]}"


def _with_wrong_field(text: str, draw: random.Random) -> str:
    """One name or number of JSON: misspelt, times a factor, or another value."""
    if draw.random() < 0.5:
        return _with_wrong_number(text, draw)
    found = draw.choice(list(re.finditer(r'"(\w+)"\s*:\s*([^,\[\]{}]*)', text)))
    if draw.random() < 0.5:
        return text[: found.start(1)] + misspelt(found[1], draw) + text[found.end(1) :]
    return (
        text[: found.start(2)]
        + draw.choice((*VALUES, "null", "NaN", "Infinity"))
        + text[found.end(2) :]
    )


def _with_wrong_cell(text: str, draw: random.Random) -> str:
    """One cell of CSV, or the line that it is in."""
    rows = [row.split(",") for row in text.splitlines()]
    row = draw.choice(rows)
    if draw.random() < 0.3:
        rows.insert(draw.randrange(len(rows)), row)
    row[draw.randrange(len(row))] = draw.choice(
        (*TEXTS, misspelt(row[0], draw), "inf", "-5", "1e30", "wavelength_nm")
    )
    return "\n".join(",".join(row) for row in rows)


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


def read(kind: str, path: Path) -> str:
    """Read a file as its kind; "" if it is accepted and right in what can be compared, else what is wrong with it.

    Raises InputError where it is refused.
    """
    return READERS[kind](path)


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
            for text in ("Traceback", "pydantic", "errors.", "0x7f")
            if text in said
        ),
        "",
    )


def examined(kind: str, number: int, folder: Path) -> tuple[str, str]:
    """The result of a case, as :func:`examined_file`."""
    return examined_file(kind, *damaged(kind, number), folder)


def examined_file(kind: str, suffix: str, content: bytes, folder: Path) -> tuple[str, str]:
    """("accepted" or "refused" or "fault", why) of one file; everything but InputError is a fault."""
    path = folder / f"case{suffix}"
    path.write_bytes(content)
    if kind == "scene" and not (folder / "parts").exists():
        shutil.copytree(ROOT / "scenes" / "parts", folder / "parts")
    try:
        wrong = read(kind, path)
    except ms.InputError as error:
        wrong = sentences_wrong(str(error))
        return (
            ("fault", f"the refusal {wrong}: {str(error)[:300]!r}")
            if wrong
            else ("refused", str(error)[:200])
        )
    except Exception as error:  # what this is for
        return "fault", f"{type(error).__name__}: {str(error)[:300]!r}"
    return ("fault", f"accepted, but {wrong}") if wrong else ("accepted", "")


def numbered(start: int, count: int) -> Iterator[tuple[str, int]]:
    """(kind, number) of the cases, the kinds by turns."""
    return ((KINDS[number % len(KINDS)], number) for number in range(start, start + count))
