"""Replaces each field of right files of every kind by a value of every type, and reads what comes of it.

    python tests/attacks/fuzz_types.py

A case is a kind of file, the place of one of its fields, and the value that stands there instead. Each is accepted, or
refused in one sentence; anything else is a fault and printed.
"""

from __future__ import annotations

import copy
import json
import math
import random
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple
from xml.sax.saxutils import escape

import numpy as np
import tifffile
from fuzz_cases import DATASET, MOTION, POSES, ROOT, read, sentences_wrong

import mitsuba_sensor as ms
from mitsuba_sensor.core.signals import Illuminant
from mitsuba_sensor.files.openexr import Plane, whole_exr, write_planes
from mitsuba_sensor.files.raw_files import read_raw
from mitsuba_sensor.lab.frames.bench import read_bench
from mitsuba_sensor.output.exr import rendered_for, write_irradiance_exr
from mitsuba_sensor.output.importers.import_camera import import_camera
from mitsuba_sensor.render.light.irradiance import Irradiance, RenderedFor
from mitsuba_sensor.render.light.photons import collect
from mitsuba_sensor.render.light.statistics import RenderStatistics

Place = tuple[str | int, ...]
DEEP: Any = 0
for _ in range(60):
    DEEP = [DEEP]
VALUES: dict[str, Any] = {
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


def report(tables: dict[str, Any]) -> str:
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


MATRIX = {"rows": 3, "cols": 3, "data": [500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0]}
OPENCV = {
    "image_width": 640,
    "image_height": 480,
    "fisheye_model": 0,
    "camera_matrix": MATRIX,
    "distortion_coefficients": {"rows": 1, "cols": 5, "data": [-0.2, 0.05, 0.0, 0.0, 0.01]},
}
ROS = {**OPENCV, "camera_name": "left", "distortion_model": "plumb_bob"}
TRANSFORMS = {
    "camera_model": "OPENCV",
    "fl_x": 500.0,
    "fl_y": 500.0,
    "cx": 320.0,
    "cy": 240.0,
    "w": 640,
    "h": 480,
    "k1": -0.2,
    "p1": 0.0,
    "frames": [
        {"file_path": "a.png", "fl_x": 500.0, "transform_matrix": [[1.0, 0.0], [0.0, 1.0]]}
    ],
}
ANGLES = {"camera_angle_x": 0.8, "w": 64, "h": 32, "frames": [{"file_path": "a"}]}
TUNING = {
    "version": 2.0,
    "target": "bcm2835",
    "algorithms": [
        {"rpi.black_level": {"black_level": 4096}},
        {"rpi.noise": {"reference_constant": 40, "reference_slope": 2.7}},
        {"rpi.alsc": {"luminance_lut": [1.0 + 0.001 * k for k in range(192)]}},
    ],
}
ROW = {
    "iso": 100,
    "K": 0.1,
    "lam": 0.14,
    "sigGs": 1.0,
    "sigTL": 0.7,
    "sigR": 0.1,
    "wp": 16383,
    "bl": 512,
}
NOISE_TABLE = {"A_100": ROW, "B_200": {**ROW, "iso": 200, "K": 0.2}}
REPORT = {
    "K": 0.2,
    "QE": 55.0,
    "sigma_d": 3.0,
    "u_e_sat": 12000.0,
    "u_I_mean": 1.5,
    "PRNU1288": 0.8,
    "DSNU1288": 1.1,
}
PRESET = {
    "name": "Example",
    "sensor_type": "SCMOS",
    "resolution": [512, 640],
    "pixel_size_um": 6.5,
    "full_well_e": 30000.0,
    "bit_depth": 12,
    "bias_offset_adu": 100.0,
    "read_noise_e": 1.5,
    "gain_e_per_adu": 8.0,
    "dark_current_e_per_s": 0.1,
    "dark_current_ref_temp_c": -10.0,
    "prnu": 0.01,
    "qe_curve": {"wavelength_nm": [400.0, 500.0, 600.0], "qe": [0.5, 0.8, 0.6]},
}
BENCH = {
    "bits": 12,
    "wavelength_nm": 550.0,
    "tile": [["R", "G"], ["G", "B"]],
    "stack": [
        {
            "files": "dark*.tiff",
            "kind": "dark",
            "exposure_s": 0.1,
            "photons": 0.0,
            "temperature_k": 300.0,
            "gain": "1",
        },
        {"files": ["flat.tiff"], "kind": "flat", "exposure_s": 0.1, "photons": 500.0},
    ],
}
OWN_FACTS = {
    "exposure_s": 0.01,
    "temperature_k": 300.0,
    "gain": "100",
    "white_level_dn": 4095,
    "black_level_dn": 64.0,
    "cfa_pattern": [["R", "G"], ["G", "B"]],
}
HEADERS = "bandwidths_nm", "first_pixel", "render_statistics", "rendered_for"
FITS_CARDS = {
    "EXPTIME": 0.5,
    "CCD-TEMP": -10.0,
    "GAIN": 120,
    "BAYERPAT": "RGGB",
    "IMAGETYP": "dark",
    "NOTE": "x",
}


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
        Kind("dataset.toml", tomllib.loads(DATASET), as_text(toml), partial(read, "dataset")),
        Kind("motion.toml", tomllib.loads(MOTION), as_text(toml), partial(read, "motion")),
        Kind("poses.toml", tomllib.loads(POSES), as_text(toml), partial(read, "motion")),
        Kind("lens.json", lens, text, partial(read, "lens")),
        Kind("iset.json", iset, text, partial(read, "lens")),
        Kind("transforms.json", TRANSFORMS, text, imported),
        Kind("angles.json", ANGLES, text, imported),
        Kind("tuning.json", TUNING, text, imported),
        Kind("table.json", NOISE_TABLE, text, imported),
        Kind("rows.json", [*NOISE_TABLE.values()], text, imported),
        Kind("opencv.yml", OPENCV, text, imported),  # JSON is YAML
        Kind("ros.yaml", ROS, text, imported),
        Kind("opencv.xml", OPENCV, as_text(storage), imported),
        Kind("ros.xml", ROS, as_text(storage), imported),
        Kind("report.xml", REPORT, as_text(report), imported),
        Kind("preset.toml", PRESET, as_text(toml), imported),
        Kind("bench.toml", BENCH, as_text(toml), read_folder),
        Kind("described.tiff", OWN_FACTS, write_described_tiff, read_frames),
        Kind("frame.fits", FITS_CARDS, write_fits, read_frames),
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


def result(kind: Kind, place: Place, value: str, folder: Path) -> tuple[str, str]:
    """("accepted" or "refused" or "fault", why) of one case."""
    tables = replaced(kind.tables, place, VALUES[value])
    if not isinstance(tables, dict) and not kind.name.endswith((".json", ".yml", ".yaml")):
        return "accepted", ""  # there is no such file
    path = folder / kind.name
    kind.write(path, tables)
    try:
        said = kind.read(path)
    except ms.InputError as error:
        wrong = sentences_wrong(str(error))
        return (
            ("fault", f"the refusal {wrong}: {str(error)[:300]!r}")
            if wrong
            else ("refused", str(error)[:400])
        )
    except Exception as error:  # what this is for
        return "fault", f"{type(error).__name__}: {str(error)[:300]!r}"
    wrong = said if isinstance(said, str) else ""
    return ("fault", f"accepted, but {wrong}") if wrong else ("accepted", "")


def cases() -> list[tuple[Kind, Place, str]]:
    """All of them, in an order that any part of represents the whole."""
    every = [
        (kind, place, value)
        for kind in kinds()
        for place in places(kind.tables)
        for value in VALUES
    ]
    random.Random(1).shuffle(every)
    return every


def faults(some: list[tuple[Kind, Place, str]]) -> tuple[list[str], Counter[str]]:
    """What is wrong, as sentences; and counts of results."""
    wrong, counts = list[str](), Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        for kind, place, value in some:
            what, why = result(kind, place, value, Path(folder))
            counts[what] += 1
            if what == "fault":
                wrong.append(f"{kind.name}, {'.'.join(map(str, place))} = {value}: {why}")
    return wrong, counts


def main() -> None:
    every = cases()
    only = sys.argv[1:]
    wrong, counts = faults([one for one in every if not only or one[0].name in only])
    print("\n".join([*sorted(wrong), str(dict(counts))]))
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
