"""Noise budgets on the terminal and as JSON: of a read-out, and of all read-outs with their combination."""

from __future__ import annotations

import math

from rich.console import Group
from rich.text import Text

import mitsuba_sensor as ms

from ..output.readout_files import readout_facts
from ..stages.stage import converter_of
from ..theory.noise_budget import HEADINGS
from .tables import ResultTable

SATURATED_DN = 1e-3
"""Temporal σ of the code of a read-out that is saturated everywhere, at most; rounding alone has 0.29 DN."""


def rows_of(frames: ms.Frames) -> list[dict[str, object]]:
    """The noise budget for JSON."""
    return [row._asdict() for row in frames.noise_budget().rows]


def combined_rows(frames: ms.Frames) -> dict[str, object]:
    """The noise budget of every read-out, and the combination, for JSON."""
    rows = {name: rows_of(one) for name, one in frames.readouts.items()}
    return {"readouts": rows, "combination": combination_facts(frames)}


def combination_facts(frames: ms.Frames) -> dict[str, object]:
    """What theory says of the linear code, and by how many pixels each read-out alone counts.

    snr_db : of a pixel, mean over black against temporal noise; None in darkness.
    """
    found = frames.theory.averages(frames.stages[-1])
    signal_dn = found.mean - converter_of(frames.stages).black_level_dn
    snr_db = None
    if signal_dn > 0 and found.temporal > 0:
        snr_db = 20 * math.log10(signal_dn / math.sqrt(found.temporal))
    facts = readout_facts(frames) or []
    return {
        "mean_dn": found.mean,
        "temporal_dn2": found.temporal,
        "spatial_dn2": found.spatial,
        "snr_db": snr_db,
        "share_of_pixels": {one["name"]: one["share_of_pixels"] for one in facts},
    }


def sheet_of(frames: ms.Frames, name: str = "") -> Group:
    """The camera, and the noise budget as a table.  name : of the read-out, among several."""
    exposure, camera = frames.first.exposure, frames.camera
    called = camera.name
    if name:
        called += f", read-out {name}"
    if camera.gain is not None:
        called += f" at gain {camera.gain}"
    head = Text.assemble(
        (f"{called}, K = {camera.system_gain_dn_per_e:.4g} DN/e-", "bold"),
        f", {exposure.time_s:g} s at {exposure.temperature_k:g} K",
    )
    found = frames.noise_budget()
    table = ResultTable(HEADINGS)
    for row in found.rows:
        table.add_row(row.source, *row.cells)
    return Group(head, table, *map(Text, found.remarks))


def combined_sheet(frames: ms.Frames) -> Group:
    """The noise budget of every read-out, and a table of their combination."""
    sheets = [sheet_of(one, name) for name, one in frames.readouts.items()]
    return Group(*sheets, _combination_sheet(frames))


def _combination_sheet(frames: ms.Frames) -> Group:
    """What each read-out is of the linear code, and the mean and noise of that."""
    camera, gain = frames.camera, frames.camera.combined_readouts.nominal_gain
    head = Text.assemble(
        (f"{camera.name}, combined to {camera.code_bits} bits, {gain:.4g} DN/e-", "bold")
    )
    table = ResultTable(("read-out", "pixels it counts in alone", "temporal σ [e-]"))
    linear = camera.combined_readouts.combination.readouts
    facts = readout_facts(frames) or []
    for fact, one, own in zip(facts, frames.readouts.values(), linear, strict=True):
        sigma_dn = math.sqrt(one.theory.averages(one.stages[-1]).temporal)
        share = f"{100 * float(str(fact['share_of_pixels'])):.3g} %"
        sigma = f"{sigma_dn * own.electrons_per_dn:.4g}"
        if sigma_dn < SATURATED_DN:
            sigma = "saturated"
        table.add_row(str(fact["name"]), share, sigma)
    found = frames.theory.averages(frames.stages[-1])
    temporal_dn, spatial_dn = math.sqrt(found.temporal), math.sqrt(found.spatial)
    table.add_row("combined", "", f"{temporal_dn / gain:.4g}")
    said = (
        f"Mean of the linear code {found.mean:.6g} DN, temporal σ {temporal_dn:.4g} DN, spatial σ {spatial_dn:.4g} DN; "
        "electrons are those of the frame's exposure on the first read-out."
    )
    return Group(head, table, Text(said))
