"""The included camera files."""

from importlib import resources

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


def cameras_with_gains() -> list[str]:
    """Return the names of the included cameras that have gain settings."""
    files = ((name, SHIPPED / f"{name}.toml") for name in list_cameras())
    return [name for name, file in files if "\n[[gains]]" in file.read_text("utf-8")]
