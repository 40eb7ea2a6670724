"""What a shell proposes for the value of an option; where nothing is proposed, it proposes its own files."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable

Proposals = Callable[[str], list[str]]


def one_of(values: Iterable[object]) -> Proposals:
    """Those of the values that begin with what is typed already."""
    known = [str(value) for value in values]
    return lambda incomplete: [value for value in known if value.startswith(incomplete)]


def camera_names(incomplete: str) -> list[str]:
    """Cameras that ship with the package."""
    from ..camera.shipped import list_cameras

    return one_of(list_cameras())(incomplete)


def scene_names(incomplete: str) -> list[str]:
    """Scenes that ship with the package."""
    from ..files.shipped_scenes import list_scenes

    return one_of(list_scenes())(incomplete)


def scenes_and_files(incomplete: str) -> list[str]:
    """Scenes that ship with the package, and what begins in the same way in the current folder.

    Nothing where only files begin so: the shell itself knows best how to go on in a folder.
    """
    names = scene_names(incomplete)
    if names:
        return names + one_of(sorted(os.listdir()))(incomplete)
    return []


def camera_fields(incomplete: str) -> list[str]:
    """Fields of a camera, with the = that their value follows."""
    from ..camera.camera import Camera

    sections = {name: one.annotation for name, one in Camera.model_fields.items()}
    names = [
        f"{name}.{field}="
        for name, kind in sections.items()
        for field in getattr(kind, "model_fields", ())
    ]
    return one_of(names)(incomplete)


def noise_source_names(incomplete: str) -> list[str]:
    """What can be switched off."""
    from ..camera.datasheet_checks import noise_sources

    return one_of(noise_sources())(incomplete)


def shell_files(incomplete: str) -> list[str]:
    """Nothing, so that the shell completes the names of files."""
    return []
