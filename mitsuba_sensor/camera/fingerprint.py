"""Hashes of the camera properties that light was rendered for, and scene fields that a named camera replaces."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from ..stages.polarizers import contrast, efficiencies
from .camera import SET_BY_USER, Camera

NOT_COMPARED = {"sources", "gains", "description"}
"""Fields without effect on frames at the present gain setting."""


def differing_fields(camera: Camera, other: Camera) -> list[str]:
    """Return the fields with different values, e.g. ``adc.full_scale_v``."""
    first, second = (
        dict(flat_fields(x.model_dump(exclude=NOT_COMPARED))) for x in (camera, other)
    )
    return [name for name in first | second if first.get(name) != second.get(name)]


def unused_fields(names: Iterable[str], of_scene: Camera, given: Camera) -> list[str]:
    """Return the scene's fields that a named camera replaces, unless the user set them.

    names : set by the scene.  of_scene : the camera with them.
    """
    differing = differing_fields(of_scene, given)
    return [n for n in names if n in differing and given.sources.get(n) != SET_BY_USER]


def unused_note(names: Iterable[str], of_scene: Camera, given: Camera) -> list[str]:
    """Return the note about :func:`unused_fields`, if any."""
    unused = ", ".join(unused_fields(names, of_scene, given))
    note = f"ignored the scene's {unused}, because the named camera {given.name} replaces the scene's camera"
    return [f"{note}; change it with camera.replace"] if unused else []


def flat_fields(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, object]]:
    """Yield the dotted names and values of nested tables."""
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from flat_fields(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def response_fingerprint(camera: Camera) -> str:
    """Return a hash of the QE curves and the transmission of the lens."""
    lens, points = camera.lens, camera.quantum_efficiency.wavelengths_nm
    transmission = lens.transmission, lens.transmission_curve, lens.transmission_wavelengths_nm
    return _hash((points, sorted(efficiencies(camera).items()), transmission))


def pixel_fingerprint(camera: Camera) -> str:
    """Return a hash of the response and of the mosaic of colour filters."""
    section = camera.quantum_efficiency
    return _hash((response_fingerprint(camera), list(section.curves), section.filter_tile))


def polarizer_fingerprint(camera: Camera) -> str | None:
    """Return a hash of the polarisers' angles and contrast; None without polarisers."""
    if camera.sensor.polarizers is None:
        return None
    curve = camera.quantum_efficiency.wavelengths_nm, contrast(camera).tolist()
    return _hash((camera.sensor.polarizers, curve))


def _hash(parts: object) -> str:
    return hashlib.blake2b(repr(parts).encode(), digest_size=8).hexdigest()
