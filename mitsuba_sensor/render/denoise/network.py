"""The network of Open Image Denoise, which filters pictures; no other module knows the library."""

from __future__ import annotations

import importlib
from contextlib import ExitStack
from types import ModuleType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ...core import InputError

COLOURS = 3  # channels of a picture
MEMORY_MAX_MB = (
    400  # of the network, about: it goes through larger pictures in tiles, which takes longer
)


def library() -> ModuleType:
    """Return the module pyoidn. Raises InputError if it is not installed."""
    try:
        return importlib.import_module("pyoidn")
    except ImportError:
        raise InputError(
            "denoise needs Open Image Denoise, which this machine has not; pip install pyoidn, or leave denoise out."
        ) from None


def is_installed() -> bool:
    """Return True if Open Image Denoise can be loaded."""
    try:
        library()
    except InputError:
        return False
    return True


def name() -> str:
    """Return the name of the library, with its version."""
    from importlib import metadata  # takes a tenth of a second to import

    return f"Open Image Denoise (pyoidn {metadata.version('pyoidn')})"


class Network:
    """Filters pictures (H, W, 3) of one size, as many as there are, within ``with``; its memory is given back at the
    end, which the library's own function does not do.

    normal : (H, W, 3) of the surfaces that all pictures show, or None where they have no guides.
    """

    def __init__(self, shape: tuple[int, int], normal: NDArray[np.float32] | None) -> None:
        self._images = {
            name: np.zeros((*shape, COLOURS), np.float32) for name in ("color", "output")
        }
        if normal is not None:
            self._images["normal"] = np.ascontiguousarray(normal)
            self._images["albedo"] = np.zeros((*shape, COLOURS), np.float32)

    def __enter__(self) -> Self:
        oidn = library()
        with ExitStack() as stack:
            self._processor = stack.enter_context(oidn.Device())
            self._processor.commit()
            self._filter = stack.enter_context(oidn.Filter(self._processor))
            for name, image in self._images.items():
                self._filter.set_image(name, image, oidn.OIDN_FORMAT_FLOAT3)
            self._filter.set_bool("hdr", True)
            self._filter.set_bool("cleanAux", "albedo" in self._images)
            self._filter.set_int("maxMemoryMB", MEMORY_MAX_MB)
            self._filter.commit()
            self._open = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()
        self._images = {}

    def filtered(
        self, colours: NDArray[np.float32], albedo: NDArray[np.float32] | None
    ) -> NDArray[np.float32]:
        """Return what the network makes of a picture, (H, W, 3), until the next one.  albedo : (H, W, 3)."""
        self._images["color"][...] = colours
        if albedo is not None:
            self._images["albedo"][...] = albedo
        self._filter.execute()
        problem = self._processor.get_error()
        if problem is not None:
            raise RuntimeError(f"Open Image Denoise: {problem}")
        return self._images["output"]
