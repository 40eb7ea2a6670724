"""Small datasets for tests."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mitsuba_sensor.dataset.file import read_dataset
from mitsuba_sensor.dataset.index_part import Line, all_parts, kinds_of, part_of
from mitsuba_sensor.dataset.record import FILE, INDEX
from mitsuba_sensor.files.parquet import Kind

SCENES = Path(__file__).parents[2] / "scenes"
TABLES: dict[str, Any] = {
    "name": "small",
    "render": {"spp": 16, "width": 16},
    "scenes": [{"name": "flat", "file": "flat_field.xml"}],
    "cameras": [{"camera": "konnik_table1"}],
}


def write_index(
    folder: Path, lines: Sequence[Line], kinds: Mapping[str, Kind] | None = None
) -> None:
    """Replace the index of a small dataset by one with these lines, as somebody could who knows how names are made."""
    (old,) = all_parts(folder)
    known = kinds or kinds_of(read_dataset(folder / FILE))
    (folder / INDEX / old.name).unlink()
    part, content = part_of(old.origin, 0, lines, len(lines), known)
    (folder / INDEX / part.name).write_bytes(content)
