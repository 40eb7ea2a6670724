"""Which camera light was made for: hashes of what detects it."""

from __future__ import annotations

import hashlib

from .camera import Camera


def response_fingerprint(camera: Camera) -> str:
    """A hash of the camera's QE curves and the transmission of its lens."""
    section = camera.quantum_efficiency
    lens = (
        camera.lens.transmission,
        camera.lens.transmission_curve,
        camera.lens.transmission_wavelengths_nm,
    )
    return _hash((section.wavelengths_nm, sorted(section.curves.items()), lens))


def pixel_fingerprint(camera: Camera) -> str:
    """The same and how the filters repeat: of what each pixel detects."""
    section = camera.quantum_efficiency
    return _hash((response_fingerprint(camera), list(section.curves), section.filter_tile))


def _hash(parts: object) -> str:
    return hashlib.blake2b(repr(parts).encode(), digest_size=8).hexdigest()
