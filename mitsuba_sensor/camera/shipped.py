"""The included camera files."""

import re
from importlib import resources
from pathlib import Path

DEFAULT_CAMERA = "konnik_table1"
"""The camera if neither the user nor the scene names one."""

SHIPPED = resources.files(__package__) / "cameras"


def list_cameras() -> list[str]:
    """Return the names of the included cameras.

    ::

        for name in ms.list_cameras():
            print(name)
    """
    return sorted(
        file.name.removesuffix(".toml")
        for file in SHIPPED.iterdir()
        if file.name.endswith(".toml")
    )


def cameras_with_gains(label: str) -> list[str]:
    """Return the names of the included cameras that have this gain setting; if none has it, of those with any."""
    texts = {name: shipped_text(name) for name in list_cameras()}
    setting = re.compile(rf"\n\[\[gains\]\]\n(?:iso|name) = \"?{re.escape(label)}\"?\n")
    with_label = [name for name, text in texts.items() if setting.search(text)]
    return with_label or [name for name, text in texts.items() if "\n[[gains]]" in text]


def shipped_text(name: str) -> str:
    """Return the text of an included camera file."""
    from ..files.texts import text_of_file

    return text_of_file(Path(str(SHIPPED / f"{name}.toml")), "install mitsuba-sensor again")
