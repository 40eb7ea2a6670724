"""Copies of included scenes for the user to change."""

from __future__ import annotations

from pathlib import Path

from ..core import InputError
from .appearing import require_folder, write_drawing
from .disk_errors import disk_sentences
from .scene_references import scene_references
from .shipped_scenes import MOTION, scene_file


def copy_scene(name: str, folder: str | Path, force: bool = False) -> list[Path]:
    """Copy an included scene, the files that it reads, and its motion file; return the copies, the scene first.

    force : overwrite files that differ.  Raises InputError.
    """
    require_folder(folder)
    scene = scene_file(name)
    motion = scene.with_suffix(MOTION)
    read = [file for file in scene_references(scene, {}) if file != scene]
    files = [scene, *read, *([motion] if motion.is_file() else [])]
    contents = {
        Path(folder, file.relative_to(scene.parent)): file.read_bytes() for file in files
    }
    for copy, content in contents.items():
        if copy.is_dir() or (copy.exists() and not force and copy.read_bytes() != content):
            raise InputError(
                f"{copy} exists already and differs; force=True overwrites it, or give another folder."
            )
    with disk_sentences(Path(folder)):
        for copy in contents:
            copy.parent.mkdir(parents=True, exist_ok=True)
    for copy, content in reversed(contents.items()):
        write_drawing(copy, content)
    return list(contents)
