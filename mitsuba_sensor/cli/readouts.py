"""What the command line shows of a camera with several read-outs."""

from __future__ import annotations

import mitsuba_sensor as ms

from ..camera.figures import emva_figures
from ..theory.dynamic_range import hdr_figures
from .tables import ResultTable

SHORT = ms.Exposure(0.0)


def hdr_facts(camera: ms.Camera) -> dict[str, object] | None:
    """Dynamic range and dips of the SNR, for JSON; None of a camera with one read-out."""
    if not camera.readouts:
        return None
    return hdr_figures(camera, SHORT).to_dict()


def readout_table(camera: ms.Camera) -> ResultTable:
    """A row for every read-out, and what their combination can tell apart."""
    table = ResultTable(
        ("read-out", "of", "K [DN/e-]", "dark noise [e-]", "saturation [e-]", "bits")
    )
    for readout in camera.readouts:
        one = camera.readout_cameras[readout.name]
        figures = emva_figures(one, SHORT)
        numbers = (
            figures.system_gain_dn_per_e,
            figures.temporal_dark_noise_e,
            figures.saturation_e,
        )
        cells = (readout.name, readout.of, *(f"{x:.4g}" for x in numbers), str(one.adc.bits))
        table.add_row(*cells)
    found = hdr_figures(camera, SHORT)
    table.below = (
        f"combined to {camera.code_bits} bits: dynamic range {found.dynamic_range_emva_db:.1f} dB by EMVA 1288, "
        f"{found.dynamic_range_iso_db:.1f} dB by ISO 15739; the SNR falls by "
        f"{', '.join(f'{x:.2g}' for x in found.dips_db)} dB where read-outs hand over"
    )
    return table
