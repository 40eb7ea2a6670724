"""Lens corrections of a DNG: read from the file by the specification's own formulas, they undo what the lens does."""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from helpers import ROOT
from helpers.marks import one_in

import mitsuba_sensor as ms

CORNELL = ROOT / "scenes/cornell_box.xml"
BROWN = (-0.25, 0.05, 0.001, -0.002, 0.01)
HEIGHTS = [0.0, 0.5, 1.0, 2.0, 4.0, 20.0]


def opcodes(path: Path) -> dict[int, tuple[float, ...]]:
    """Number of the opcode → its doubles, parsed as DNG 1.4 describes a list of opcodes."""
    with tifffile.TiffFile(path) as file:
        tag = file.pages[0].tags.get(51022)  # type: ignore[union-attr]
        content = bytes(tag.value) if tag else b""
    if not content:
        return {}
    found, place = {}, 4
    for _ in range(struct.unpack(">I", content[:4])[0]):
        number, version, flags, size = struct.unpack_from(">I4sII", content, place)
        assert version == b"\x01\x03\0\0" and flags == 1
        skipped = 4 if number == 1 else 0  # the count of colour planes
        found[number] = struct.unpack_from(
            f">{(size - skipped) // 8}d", content, place + 16 + skipped
        )
        place += 16 + size
    assert place == len(content)
    return found


def normalised(
    values: tuple[float, ...], shape: tuple[int, ...]
) -> tuple[np.ndarray, np.ndarray, float, Any]:
    """Δx, Δy over the distance of the farthest corner from the optical centre, that distance, and the centre."""
    rows, columns = shape
    centre = values[-2] * (columns - 1), values[-1] * (rows - 1)
    reach = math.hypot(
        *(max(c, n - 1 - c) for c, n in zip(centre, (columns, rows), strict=True))
    )
    y, x = np.mgrid[:rows, :columns]
    return (x - centre[0]) / reach, (y - centre[1]) / reach, reach, centre


def taken(tmp_path: Path, **fields: Any) -> tuple[ms.Capture, dict[int, tuple[float, ...]]]:
    camera = ms.load_camera("bayer_2mp").replace(
        **{f"lens.{name}": value for name, value in fields.items()}
    )
    captured = ms.capture(CORNELL, camera, width=64, spp=2, denoise=False)
    captured.frames.save_dng(tmp_path / "frame.dng")
    return captured, opcodes(tmp_path / "frame.dng")


def test_warp_rectilinear_is_the_distortion_of_the_lens(tmp_path: Path) -> None:
    """Every pixel of the corrected picture comes from where OpenCV's formula has its image, to 1e-6 px."""
    captured, found = taken(tmp_path, distortion=BROWN)
    shape, matrix = (
        captured.frames.digital.shape[1:],
        captured.metadata["render"]["intrinsics"]["matrix"],
    )
    x, y, reach, centre = normalised(found[1], shape)
    kr0, kr1, kr2, kr3, kt0, kt1 = found[1][:6]
    r2 = x**2 + y**2
    f = kr0 + r2 * (kr1 + r2 * (kr2 + r2 * kr3))
    from_x = centre[0] + reach * (f * x + kt0 * 2 * x * y + kt1 * (r2 + 2 * x**2))
    from_y = centre[1] + reach * (f * y + kt1 * 2 * x * y + kt0 * (r2 + 2 * y**2))
    k1, k2, p1, p2, k3 = BROWN
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    u, v = (columns - matrix[0][2]) / matrix[0][0], (rows - matrix[1][2]) / matrix[1][1]
    s2 = u**2 + v**2
    g = 1 + k1 * s2 + k2 * s2**2 + k3 * s2**3
    to_x = u * g + 2 * p1 * u * v + p2 * (s2 + 2 * u**2)
    to_y = v * g + p1 * (s2 + 2 * v**2) + 2 * p2 * u * v
    np.testing.assert_allclose(from_x, to_x * matrix[0][0] + matrix[0][2], atol=1e-6)
    np.testing.assert_allclose(from_y, to_y * matrix[1][1] + matrix[1][2], atol=1e-6)
    assert np.abs(from_x - columns).max() > 0.5  # it does something


@pytest.mark.parametrize(
    ("fields", "tolerance"),
    one_in(
        3,
        [
            ({}, 3e-4),
            ({"distortion": (-0.25, 0.05, 0.0, 0.0, 0.0)}, 1e-3),
            (
                {
                    "relative_illumination": [1.0, 0.97, 0.9, 0.7, 0.4, 0.1],
                    "relative_illumination_heights_mm": HEIGHTS,
                },
                0.02,
            ),
        ],
        several=True,
    ),
)
def test_fix_vignette_radial_is_the_inverse_of_the_shading(
    fields: dict[str, Any], tolerance: float, tmp_path: Path
) -> None:
    """Of cos⁴, of cos⁴ with distortion, and of a table, whose corners a polynomial rounds; by the frame's own light."""
    captured, found = taken(tmp_path, **fields)
    shape = captured.frames.digital.shape[1:]
    x, y, reach, _ = normalised(found[3], shape)
    r2 = x**2 + y**2
    gain = 1 + sum(k * r2 ** (power + 1) for power, k in enumerate(found[3][:5]))
    shading = captured.metadata["render"]["intrinsics"]["shading"]
    known = np.interp(
        np.sqrt(r2) * reach, shading["radius_px"], shading["relative_illumination"]
    )
    np.testing.assert_allclose(gain * known, 1, atol=tolerance)
    if not fields:  # cos⁴ itself
        tangent = (
            np.sqrt(r2) * reach / captured.metadata["render"]["intrinsics"]["matrix"][0][0]
        )
        np.testing.assert_allclose(gain, (1 + tangent**2) ** 2, rtol=1e-3)


def test_light_from_an_array_has_no_corrections(tmp_path: Path) -> None:
    camera = ms.load_camera("bayer_2mp")
    frames = ms.expose(np.full((24, 24), 1000.0), camera, ms.Exposure(0.01))
    frames.save_dng(tmp_path / "frame.dng")
    assert opcodes(tmp_path / "frame.dng") == {}
