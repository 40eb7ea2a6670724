"""Small datasets for tests."""

from pathlib import Path
from typing import Any

SCENES = Path(__file__).parents[2] / "scenes"
TABLES: dict[str, Any] = {
    "name": "small",
    "render": {"spp": 16, "width": 16},
    "scenes": [{"name": "flat", "file": "flat_field.xml"}],
    "cameras": [{"camera": "konnik_table1"}],
}
