"""The reference sets of EMVA 1288, measured here and by the package emva1288: the table of docs/lab.md.

    git clone https://github.com/EMVA1288/datasets && pip install emva1288==1.0.2
    python benchmarks/emva_sets.py datasets

One row a figure: the set, here with its 95 % interval, emva1288, and what the simulated set 003 was made with.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import mitsuba_sensor as ms

FIGURES = {
    "K": "K",
    "η": "QE",
    "σ_d": "sigma_d",
    "DSNU1288": "DSNU1288",
    "PRNU1288": "PRNU1288",
    "µ_e.sat": "u_e_sat",
    "µ_I.mean": "u_I_mean",
}
"""Symbols here, and names of the package."""
PUT_IN = {"K": 0.1, "η": 0.5 * 0.9888, "σ_d": 30.0, "DSNU1288": 21.2}
"""Of set 003, by its descriptor; the light falls off, to 0.9888 of that of the centre on average."""


def of_emva1288(descriptor: Path) -> dict[str, float]:
    """Figures of the package of the standard's authors; nothing where it is not installed or fails."""
    np.asfarray = lambda values, dtype=float: np.asarray(values, dtype)  # type: ignore[attr-defined]
    try:
        from emva1288.process.data import Data1288
        from emva1288.process.loader import LoadImageData
        from emva1288.process.parser import ParseEmvaDescriptorFile
        from emva1288.process.results import Results1288
    except ModuleNotFoundError:
        return {}

    from mitsuba_sensor.files.raw_files import read_raw

    def load(file: str) -> np.ndarray:
        return np.asarray(read_raw(file).frames[0], np.int64)

    images = ParseEmvaDescriptorFile(str(descriptor), loglevel=50).images
    loaded = LoadImageData(images, path=str(descriptor.parent), loglevel=50, fload=load)
    found = Results1288(Data1288(loaded.data, loglevel=50).data, loglevel=50)
    figures = {}
    for symbol, name in FIGURES.items():
        value = getattr(found, name, None)
        if value is not None:
            figures[symbol] = float(value() if callable(value) else value)
    figures["η"] /= 100
    return figures


def main(folder: Path) -> None:
    """Print the table in Markdown."""
    print("| set | figure | here (95 %) | emva1288 | put in |\n|---|---|---|---|---|")
    for descriptor in sorted(folder.glob("*/EMVA1288_Data.txt")):
        number = descriptor.parent.name.split("_")[2]
        (found,) = ms.lab.measure_bench(ms.lab.read_bench(descriptor))
        peer = of_emva1288(descriptor)
        for symbol in FIGURES:
            figure = found.figures.get(symbol)
            if figure is None:
                continue
            here = f"{figure.value:.4g} ({figure.low:.4g} to {figure.high:.4g})"
            if figure.is_bound:
                here = figure.shown
            other = f"{peer[symbol]:.4g}" if symbol in peer else ""
            true = f"{PUT_IN[symbol]:.4g}" if number == "003" and symbol in PUT_IN else ""
            print(f"| {number} | {symbol} [{figure.unit}] | {here} | {other} | {true} |")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
