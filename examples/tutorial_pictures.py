"""Run the notebook of the tutorial without Jupyter, and make the pictures of docs/tutorial.md.

python examples/tutorial_pictures.py                                       # small, into the current folder
python examples/tutorial_pictures.py docs/images --width 192 --spp 512     # the pictures of docs/tutorial.md
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import mitsuba_sensor as ms
from mitsuba_sensor.dataset.card import caption
from mitsuba_sensor.files.png import write_png
from mitsuba_sensor.output.contact_sheet import Captioned, SheetRow, contact_sheet

NOTEBOOK = Path(__file__).with_name("tutorial.ipynb")
SIZE = "width, spp = 48, 64"


def run_notebook(width: int, spp: int) -> dict[str, Any]:
    """The names that its cells leave, in another size."""
    names: dict[str, Any] = {}
    for cell in json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            code = "".join(cell["source"])
            exec(code.replace(SIZE, f"width, spp = {width}, {spp}"), names)
    return names


def rows_of(dataset: ms.Dataset) -> list[SheetRow]:
    """Previews of a dataset: a row for each scene and chip, in the order of the exposures, as in its contact sheet."""
    rows = defaultdict[Any, list[Captioned]](list)
    for sample in dataset:
        lines = caption(sample.line, ())
        picture = Captioned(sample.files["frame.png"], lines)
        rows[sample.values["scene"], f"chip {sample.values['serial']}", sample.split].append(
            picture
        )
    return [SheetRow(label, pictures) for label, pictures in rows.items()]


def main() -> None:
    """Parse the options, run the cells, write two PNG files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path, default=Path("."))
    parser.add_argument("--width", type=int, default=32)
    parser.add_argument("--spp", type=int, default=16)
    options = parser.parse_args()
    names = run_notebook(options.width, options.spp)
    options.folder.mkdir(parents=True, exist_ok=True)
    frame = names["metered"].preview()
    write_png(options.folder / "tutorial_frame.png", frame)
    sheet = contact_sheet(rows_of(ms.Dataset(names["out"] / "pairs")))
    write_png(options.folder / "tutorial_dataset.png", sheet)


if __name__ == "__main__":
    main()
