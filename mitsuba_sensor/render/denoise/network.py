"""Image filter of Open Image Denoise; no other module uses the library."""

from __future__ import annotations

import importlib
import importlib.util
from contextlib import ExitStack
from types import ModuleType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ...core import InputError

COLOURS = 3  # channels of an image
MEMORY_MAX_MB = (
    400  # of the network, about: larger images are cut into tiles, which takes longer
)


def library() -> ModuleType:
    """Return the module pyoidn. Raises InputError if it cannot be imported."""
    try:
        return importlib.import_module("pyoidn")
    except ImportError:
        raise InputError(
            "denoise needs Open Image Denoise, which is not installed; run `pip install pyoidn`, or omit denoise."
        ) from None


def is_installed() -> bool:
    """Return True if Open Image Denoise is installed; it is not loaded."""
    return importlib.util.find_spec("pyoidn") is not None


def name() -> str:
    """Return the name of the library, with its version."""
    from importlib import metadata  # takes a tenth of a second to import

    return f"Open Image Denoise (pyoidn {metadata.version('pyoidn')})"


class Network:
    """Context manager that filters images (H, W, 3) of one size, and frees its memory at the end, which the library's
    own function does not do.

    normal : (H, W, 3) of the surfaces in all images, or None without guides.
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
        """Return the filtered image (H, W, 3), which the next call overwrites.  albedo : (H, W, 3)."""
        self._images["color"][...] = colours
        if albedo is not None:
            self._images["albedo"][...] = albedo
        self._filter.execute()
        problem = self._processor.get_error()
        if problem is not None:
            raise RuntimeError(f"Open Image Denoise: {problem}")
        return self._images["output"]
