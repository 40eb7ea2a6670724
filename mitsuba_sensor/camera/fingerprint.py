"""Which camera light was made for: hashes of what detects it, and which fields of a scene a named camera has not."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from ..stages.polarizers import contrast, efficiencies
from .camera import SET_BY_USER, Camera

NO_NUMBERS = {"sources", "gains", "description"}
"""Of a camera file: what no frame depends on, and other settings of the same camera."""


def differing_fields(camera: Camera, other: Camera) -> list[str]:
    """Fields that the cameras have otherwise, or one of them has not, ``adc.full_scale_v`` for example."""
    one, two = (
        dict(flat_fields(each.model_dump(exclude=NO_NUMBERS))) for each in (camera, other)
    )
    return [name for name in one | two if one.get(name) != two.get(name)]


def unused_fields(names: Iterable[str], of_scene: Camera, given: Camera) -> list[str]:
    """Fields that a scene sets and a camera named by the user has otherwise, unless the user set them himself.

    names : set by the scene.  of_scene : the camera with them.
    """
    differing = differing_fields(of_scene, given)
    return [n for n in names if n in differing and given.sources.get(n) != SET_BY_USER]


def unused_note(names: Iterable[str], of_scene: Camera, given: Camera) -> list[str]:
    """The sentence about :func:`unused_fields`, or none."""
    unused = unused_fields(names, of_scene, given)
    if not unused:
        return []
    return [
        f"not used of the scene: {', '.join(unused)}; the camera {given.name} was named, and a named camera is as its "
        "file says"
    ]


def flat_fields(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, object]]:
    """Fields of nested tables under dotted names, with their values."""
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from flat_fields(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def response_fingerprint(camera: Camera) -> str:
    """A hash of the camera's QE curves and the transmission of its lens."""
    section = camera.quantum_efficiency
    lens = (
        camera.lens.transmission,
        camera.lens.transmission_curve,
        camera.lens.transmission_wavelengths_nm,
    )
    return _hash((section.wavelengths_nm, sorted(efficiencies(camera).items()), lens))


def pixel_fingerprint(camera: Camera) -> str:
    """The same and how the filters repeat: of what each pixel detects."""
    section = camera.quantum_efficiency
    return _hash((response_fingerprint(camera), list(section.curves), section.filter_tile))


def polarizer_fingerprint(camera: Camera) -> str | None:
    """A hash of the angles of the polarisers and of how they extinguish light; None without polarisers."""
    if camera.sensor.polarizers is None:
        return None
    extinguished = camera.quantum_efficiency.wavelengths_nm, contrast(camera).tolist()
    return _hash((camera.sensor.polarizers, extinguished))


def _hash(parts: object) -> str:
    return hashlib.blake2b(repr(parts).encode(), digest_size=8).hexdigest()
