"""Ten EMVA 1288 sheets of makers: what their figures say of each other, and what frames of such a camera measure.

    python benchmarks/published_sheets.py [--side 192] [--camera ASI2600MM] [--json]

Each sheet becomes a camera as ``mitsuba-sensor cameras new --emva`` makes it. Where a sheet has no gain, the converter
ends at the saturation capacity. Printed, then computed from the sheet's own σ_d and saturation by Release 4 and by
Release 3 (whose absolute sensitivity threshold has no ¼ under the root), then measured by our lab with its interval.
Five gain settings of one camera, as a laboratory measured them, are a table of their own.
"""

from __future__ import annotations

import argparse
import json
import math
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from datasheets import TEMPERATURE_K, UNSAID, WAVELENGTH_NM

import mitsuba_sensor as ms
from mitsuba_sensor.camera.emva_sheet import EmvaSheet, camera_of_sheet
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.emva_linear import EmvaLinear, emva_linear

Sheet = dict[str, Any]
FILE = Path(__file__).with_suffix(".json")
EXPOSURE = ms.Exposure(0.001, temperature_k=TEMPERATURE_K)
LEVELS, FRAMES = 50, 4
USUAL_QE = 60.0  # percent, where a sheet has none
TOP = 0.95
"""Of the codes, above the black level: where the saturation capacity lies if a sheet has no gain."""


def _highest_dn(sheet: Sheet) -> int:
    return (1 << int(sheet["bits"])) - 1


def saturation_e(sheet: Sheet) -> float:
    """As printed, or where the converter ends."""
    if "saturation" in sheet:
        return float(sheet["saturation"])
    return TOP * _highest_dn(sheet) * float(sheet["e_per_dn"])


def camera_of(sheet: Sheet) -> ms.Camera:
    """Without fixed patterns and dark current, which these sheets do not have."""
    saturation, sigma = saturation_e(sheet), float(sheet["sigma_d"])
    gain = TOP * _highest_dn(sheet) / saturation
    if "e_per_dn" in sheet:
        gain = 1 / float(sheet["e_per_dn"])
    rows = UNSAID | {
        "pitch_um": sheet["pitch_um"],
        "bits": sheet["bits"],
        "wavelength_nm": sheet.get("wavelength_nm", WAVELENGTH_NM),
        "qe_percent": float(sheet.get("qe", USUAL_QE)),
        "gain_dn_per_e": float(sheet.get("gain", gain)),
        "read_noise_e": sigma,
        "saturation_e": saturation,
    }
    return camera_of_sheet(EmvaSheet(**rows), "of_the_sheet", sheet["camera"])


def computed(sheet: Sheet, camera: ms.Camera, release: int) -> dict[str, float]:
    """Threshold [e-], dynamic range [dB] and largest SNR [dB] by Release 3 or 4."""
    figures = camera.emva1288(EXPOSURE)
    noise_e = math.hypot(
        float(sheet["sigma_d"]), math.sqrt(1 / 12) / figures.system_gain_dn_per_e
    )
    threshold = noise_e + 0.5
    if release == 4:
        threshold = figures.absolute_sensitivity_e
    saturation = saturation_e(sheet)
    return {
        "threshold": threshold,
        "dynamic_range": 20 * math.log10(saturation / threshold),
        "snr_max": 10 * math.log10(saturation),
    }


def measured(camera: ms.Camera, side: int) -> EmvaLinear:
    """Our lab's figures of frames of this camera."""
    efficiency = float(
        camera.qe([camera.quantum_efficiency.reference_nm or WAVELENGTH_NM])[0, 0]
    )
    top = 1.1 * camera.emva1288(EXPOSURE).saturation_e / efficiency
    stacks = []
    for number, photons in enumerate(np.linspace(0.0, top, LEVELS + 1).tolist()):
        light = np.full((side, side), photons)
        frames = ms.expose(light, camera, EXPOSURE, frames=FRAMES, seed=number).digital
        stacks.append(Stack(frames, EXPOSURE.time_s, photons=photons, bits=camera.adc.bits))
    return emva_linear(stacks[:1], stacks[1:])


def row_of(sheet: Sheet, side: int) -> dict[str, Any]:
    """Printed, computed and measured figures of one sheet."""
    camera = camera_of(sheet)
    found = measured(camera, side)
    symbols = {"gain": "K", "qe": "η", "sigma_d": "σ_d", "saturation": "µ_e.sat"}
    figures = {name: found[symbol] for name, symbol in symbols.items()}
    return {
        "camera": sheet["camera"],
        "printed": {name: value for name, value in sheet.items() if isinstance(value, str)},
        "release_4": computed(sheet, camera, 4),
        "release_3": computed(sheet, camera, 3),
        "measured": {
            **{name: [one.value, one.low, one.high] for name, one in figures.items()},
            "e_per_dn": [
                1 / one for one in (found["K"].value, found["K"].high, found["K"].low)
            ],
        },
    }


def table(rows: list[dict[str, Any]]) -> str:
    """Markdown: a row per sheet. A measured figure has half of its interval behind it."""
    head = ["camera", "σ_d [e-]", "measured", "QE [%]", "measured", "µ_e.sat [e-]", "measured"]
    head += ["µ_e.min [e-]", "R3", "R4", "DR [dB]", "R3", "R4"]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for row in rows:
        printed, third, fourth = row["printed"], row["release_3"], row["release_4"]
        columns = (("sigma_d", 1), ("qe", 100), ("saturation", 1))
        cells = [row["camera"], *_beside_printed(row, columns)]
        for name, digits in (("threshold", 2), ("dynamic_range", 1)):
            computed_by = [f"{one[name]:.{digits}f}" for one in (third, fourth)]
            cells += [printed.get(name, "–"), *computed_by]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def table_of_gains(rows: list[dict[str, Any]]) -> str:
    """Markdown: a row per gain setting."""
    head = ["camera", "1/K [e-/DN]", "measured", "σ_d [e-]", "measured"]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for row in rows:
        cells = [row["camera"], *_beside_printed(row, (("e_per_dn", 1), ("sigma_d", 1)))]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _beside_printed(row: dict[str, Any], columns: Iterable[tuple[str, float]]) -> list[str]:
    """Printed and measured figures in turns.  columns : name, and factor to the unit in which it is printed."""
    cells = []
    for name, factor in columns:
        value, low, high = (factor * one for one in row["measured"][name])
        cells += [row["printed"].get(name, "–"), f"{value:.4g} ± {(high - low) / 2:.2g}"]
    return cells


def main() -> None:
    """Parse the options, measure every sheet, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--side", type=int, default=192, help="rows and columns (default 192)")
    parser.add_argument("--camera", default="", help="only those whose names have this in them")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    asked = parser.parse_args()
    warnings.simplefilter("ignore")  # saturated levels are wanted
    sheets = [one for one in json.loads(FILE.read_text()) if asked.camera in one["camera"]]
    rows = [row_of(sheet, asked.side) for sheet in sheets]
    if asked.json:
        print(json.dumps(rows))
        return
    gains = [row for row in rows if "e_per_dn" in row["printed"]]
    makers = [row for row in rows if row not in gains]
    for one, drawn in ((makers, table), (gains, table_of_gains)):
        if one:
            print(drawn(one), end="\n\n")


if __name__ == "__main__":
    main()
