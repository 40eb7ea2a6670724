"""What a render found, before it is an irradiance with camera, bands and statistics."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Estimate(NamedTuple):
    """What a render found, as a file has it.

    data, standard_error : (H, W, B) mean and standard error per band [W m⁻² nm⁻¹].  relative_error, in_band : (H, W),
        see :class:`light.irradiance.Irradiance`.
    """

    data: NDArray[np.float32]
    standard_error: NDArray[np.float32]
    relative_error: NDArray[np.float32]
    in_band: NDArray[np.float32] | None
