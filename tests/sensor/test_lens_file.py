"""Lens tables: our own JSON, PBRT's and ISET3d's, and what is wrong with the others, in one sentence."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from helpers.lens_oracle import DOUBLE_GAUSS

import mitsuba_sensor as ms

CAMERA = ms.load_camera("konnik_table1")
TABLE = "\n".join(f"{r}\t{t}\t{0 if r == 0 else n}\t{d}" for r, t, n, d in DOUBLE_GAUSS)


def with_lens(**fields: Any) -> ms.Camera:
    return CAMERA.replace(**{f"lens.{name}": value for name, value in fields.items()})


def surfaces(camera: ms.Camera) -> Any:
    assert camera.lens.prescription is not None
    return camera.lens.prescription.surfaces


def test_the_shipped_double_gauss_is_the_published_table() -> None:
    found = surfaces(with_lens(prescription="double_gauss"))
    assert [
        (s.radius_mm or 0, s.thickness_mm, s.index, 2 * s.semi_diameter_mm) for s in found
    ] == list(DOUBLE_GAUSS)
    assert [s.stop for s in found].index(True) == 5


@pytest.mark.parametrize(
    "before", ["# D-GAUSS F/2\n# US patent 2,673,491\n", "# focal length\n50\n", "\ufeff"]
)
def test_a_dat_table_is_the_same_lens(tmp_path: Path, before: str) -> None:
    """Four columns as PBRT has them; comments are the source, a lone number is passed over."""
    path = tmp_path / "dgauss.dat"
    path.write_text(before + TABLE, encoding="utf-8")
    read, shipped = (
        surfaces(with_lens(prescription=lens)) for lens in (str(path), "double_gauss")
    )
    assert [s.model_copy(update={"abbe": None}) for s in shipped] == list(read)


def test_a_fifth_column_is_the_abbe_number(tmp_path: Path) -> None:
    path = tmp_path / "lens.dat"
    path.write_text("0 2 0 6 0\n25.8 5.3 1.5168 25.4 64.17\n0, 0, 1, 25.4, 0", encoding="utf-8")
    found = surfaces(with_lens(prescription=str(path), f_number=9.0))
    assert [(s.abbe, s.stop) for s in found] == [(None, True), (64.17, False), (None, False)]


def test_an_iset_table_is_the_same_lens(tmp_path: Path) -> None:
    rows = [
        {
            "radius": r,
            "thickness": t,
            "ior": n,
            "semi_aperture": [d / 2, d / 2],
            "conic_constant": [0.0, 0.0],
        }
        for r, t, n, d in DOUBLE_GAUSS
    ]
    path = tmp_path / "dgauss.json"
    path.write_text(
        json.dumps({"description": "from a book", "name": "D-Gauss", "surfaces": rows}),
        encoding="utf-8",
    )
    read = with_lens(prescription=str(path))
    shipped = surfaces(with_lens(prescription="double_gauss"))
    assert [s.model_copy(update={"abbe": None}) for s in shipped] == list(surfaces(read))
    assert (read.lens.prescription.name, read.lens.prescription.source) == (
        "D-Gauss",
        "from a book",
    )


def test_a_camera_file_finds_its_lens_beside_it_and_keeps_it(tmp_path: Path) -> None:
    """The camera holds the surfaces, not the path: it is the same when the file is gone."""
    from mitsuba_sensor.camera.shipped import SHIPPED

    text = (
        (SHIPPED / "konnik_table1.toml")
        .read_text("utf-8")
        .replace("[lens]", '[lens]\nprescription = "mine.dat"')
    )
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    (tmp_path / "mine.dat").write_text(TABLE, encoding="utf-8")
    camera = ms.load_camera(tmp_path / "mine.toml")
    (tmp_path / "mine.dat").unlink()
    changed = camera.replace(**{"adc.bits": 10})
    assert changed.lens == camera.lens and len(surfaces(changed)) == 11


STOP, PLANE = '{"semi_diameter_mm": 1, "stop": true%s}', '{"semi_diameter_mm": 1%s}'


def table_of(*surfaces: str) -> str:
    return f'{{"surfaces": [{", ".join(surfaces)}]}}'


ISET = '{"semi_aperture": 3, "radius": 1, "thickness": 1%s}'
FILES = {
    "missing.dat": (None, "cannot be read: No such file"),
    "short.dat": (
        "1 2 3",
        "the line '1 2 3'; it must be radius, thickn",
    ),
    "letters.dat": ("s 2 1 4", "'s 2 1 4'; it must be radius"),
    "nan.dat": ("0 2 0 6\nnan 5 1.5 25\n0 0 1 25", "radius_mm is nan"),
    "stopless.dat": (
        "50 2 1.5 20\n-50 0 1 20",
        "has no aperture stop; add a line with radius 0",
    ),
    "broken.json": ("{", "is not valid JSON"),
    "list.json": ("[]", "has no list of surfaces"),
    "iset.json": (table_of(ISET % ""), "without numbers for radius"),
    "oval.json": (
        table_of(ISET % ', "ior": 1, "conic_constant": [3, 4]'),
        "without numbers for radius",
    ),
    "typo.json": (table_of(PLANE % ', "radius": 3', PLANE % ""), "is not a field"),
    "two.json": (
        table_of(STOP % "", STOP % ""),
        "2 surfaces are the aperture stop; mark exactly",
    ),
    "immersed.json": (table_of(STOP % "", PLANE % ', "index": 1.5'), "the sensor is in air"),
    "zero.json": (table_of(STOP % "", PLANE % ', "radius_mm": 0'), "omit it for a plane"),
    "vacuum.json": (table_of(STOP % ', "abbe": 30', PLANE % ""), "abbe"),
    "lens.len": ("", "or a .json, .dat, .zmx, .seq file"),
}


@pytest.mark.parametrize("name", FILES)
def test_a_wrong_lens_file_is_one_sentence(name: str, tmp_path: Path) -> None:
    text, says = FILES[name]
    if text is not None:
        (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises(ms.InputError) as caught:
        with_lens(prescription=str(tmp_path / name))
    message = str(caught.value)
    assert (
        says in message
        and message.startswith("konnik_table1: lens.prescription")
        and "\n" not in message
    )
