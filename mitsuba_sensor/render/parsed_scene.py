"""A scene file, parsed once: what it says of camera, exposure and seeds, and the variant that renders it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..core.errors import InputError
from .scene_file import SceneFile, parse_scene
from .scene_settings import SceneSettings, settings_of
from .variants import Variant, choose_variant, use


@dataclass(frozen=True, eq=False)
class ParsedScene:
    """A scene file, parsed but not built.

    settings : what the file says of camera, exposure and seeds.  variant : the Mitsuba variant that is set for it.
    """

    file: SceneFile
    settings: SceneSettings
    variant: Variant


def parse(
    scene: str | os.PathLike[str], parameters: Mapping[str, Any] | None = None, variant: str | None = None
) -> ParsedScene:
    """Parse a scene file, and set the variant. parameters, variant : as for :func:`render`. Raises InputError."""
    if not isinstance(scene, str | os.PathLike):
        raise InputError(f"scene is {scene!r}; pass the path of a scene file, e.g. 'scenes/cornell_box.xml'.")
    if parameters is not None and not isinstance(parameters, Mapping):
        raise InputError(f"parameters is {parameters!r}; pass a dict of the scene's <default> names and their values.")
    chosen = choose_variant(variant)
    use(chosen)
    file = parse_scene(scene, parameters or {})
    return ParsedScene(file, settings_of(file), chosen)
