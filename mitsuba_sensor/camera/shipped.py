"""The camera files that ship with the package."""

from importlib import resources

DEFAULT_CAMERA = "konnik_table1"
"""The camera of a scene that names none, where none is given."""

SHIPPED = resources.files(__package__) / "cameras"


def list_cameras() -> list[str]:
    """Names of the cameras that ship with the package.

    ::

        for name in ms.list_cameras():
            print(name)
    """
    return sorted(
        file.name.removesuffix(".toml")
        for file in SHIPPED.iterdir()
        if file.name.endswith(".toml")
    )
