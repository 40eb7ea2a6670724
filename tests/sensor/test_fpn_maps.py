"""Fixed patterns out, to a file, and in again: a measured sensor instead of a drawn one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms

TABLE1 = ms.load_camera("konnik_table1")
EXPOSURE = ms.Exposure(0.1)
SHAPE = (12, 17)
LIGHT = np.linspace(0, 50_000, SHAPE[0] * SHAPE[1]).reshape(SHAPE)
OPTIONS: dict[str, dict[str, Any]] = {
    "no pattern at all": {"pixel.prnu": 0.0, "dark_current.cv": 0.0, "readout.dsnu_col": 0.0},
    "wald": {
        "pixel.prnu_distribution": "lognormal",
        "dark_current.distribution": "wald",
        "dark_current.cv": 0.4,
        "readout.dsnu_row": 0.001,
        "readout.dsnu_col_coupling": 0.25,
        "pixel.dsnu_e": 20.0,
        "readout.prnu_col": 0.01,
        "readout.dsnu_residual": 0.5,
    },
    "coupled": {
        "pixel.prnu_distribution": "ar",
        "pixel.prnu_coupling": 0.25,
        "dark_current.distribution": "ar",
        "dark_current.cv": 0.2,
        "dark_current.coupling": 0.45,
        "pixel.dsnu_e": 20.0,
        "pixel.dsnu_coupling": 0.25,
    },
}


@pytest.mark.parametrize(
    ("option", "origin"),
    [("no pattern at all", (0, 0)), ("wald", (506, 1020)), ("coupled", (0, 0))],
    ids=str,
)
def test_a_sensor_is_its_maps_whatever_the_serial(
    option: str, origin: tuple[int, int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """fpn_maps() of serial 7, through a file, given to serial 99: in the same noise, the bytes of serial 7."""
    monkeypatch.setattr(ms.stages.Frame, "key", 5)
    camera = TABLE1.replace(**OPTIONS[option])
    np.savez(tmp_path / "maps.npz", **ms.fpn_maps(camera, SHAPE, serial=7, origin=origin))
    with np.load(tmp_path / "maps.npz") as maps:
        given = ms.expose(
            LIGHT, camera, EXPOSURE, serial=99, frames=2, origin=origin, maps=maps
        )
    own = ms.expose(LIGHT, camera, EXPOSURE, serial=7, frames=2, origin=origin)
    assert given.digital.tobytes() == own.digital.tobytes()


@pytest.mark.parametrize(
    "name", ["prnu", "dark_fpn", "dsnu_col_e", "dsnu_row_e", "dsnu_pixel_e", "prnu_col"]
)
def test_one_given_map_stands_in_for_one_pattern_and_for_no_other(name: str) -> None:
    """All others are the serial's own: putting the own map back in place gives the own frame, another one does not."""
    camera = TABLE1.replace(
        **{
            "readout.dsnu_row": 0.001,
            "pixel.dsnu_e": 20.0,
            "readout.prnu_col": 0.01,
            "dark_current.cv": 0.4,
        }
    )
    maps = {serial: ms.fpn_maps(camera, SHAPE, serial=serial)[name] for serial in (7, 8)}
    own = ms.expose(LIGHT, camera, EXPOSURE, serial=7).digital
    for serial, same in ((7, True), (8, False)):
        given = ms.expose(LIGHT, camera, EXPOSURE, serial=7, maps={name: maps[serial]}).digital
        assert np.array_equal(own, given) == same


@pytest.mark.parametrize("origin", [(0, 0), (2, 5), (8, 3)], ids=str)
def test_maps_of_the_whole_sensor_are_cut_to_the_window(
    origin: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A sensor of 20 × 30, a window of 12 × 17 somewhere on it: of that sensor, byte by byte, in the same noise."""
    rich = {
        "readout.dsnu_row": 0.01,
        "pixel.dsnu_e": 20.0,
        "readout.prnu_col": 0.1,
        "dark_current.cv": 0.4,
    }
    camera = TABLE1.replace(**rich | {"sensor.rows": 20, "sensor.columns": 30})
    monkeypatch.setattr(ms.stages.Frame, "key", 5)
    given = ms.expose(
        LIGHT, camera, EXPOSURE, serial=99, origin=origin, maps=ms.fpn_maps(camera, serial=7)
    )
    own = ms.expose(LIGHT, camera, EXPOSURE, serial=7, origin=origin)
    assert given.digital.tobytes() == own.digital.tobytes()
