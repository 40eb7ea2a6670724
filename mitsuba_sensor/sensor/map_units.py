"""FPN maps in digital numbers: offsets and read noise as frames show them, for those that stages have in electrons."""

from __future__ import annotations

import math
from typing import NamedTuple

from ..stages.stage import Chain, ElectronMaps


class MapInDn(NamedTuple):
    """A map that may be given in DN.  name : of the same map in electrons.  dn_per_e : of one electron there."""

    name: str
    dn_per_e: float


def maps_in_dn(stages: Chain) -> dict[str, MapInDn]:
    """``dsnu_pixel_dn`` → ``dsnu_pixel_e``, and the overall system gain K of small signals, by which they differ.

    Of offsets of which a CDS leaves a share, it is that share of K: in DN they are what it left.
    """
    found = {}
    for number, stage in enumerate(stages):
        behind = math.prod(one.nominal_gain for one in stages[number + 1 :])
        if not isinstance(stage, ElectronMaps):
            continue
        for name, gain in stage.gains_of_maps().items():
            found[f"{name.removesuffix('_e')}_dn"] = MapInDn(name, gain * behind)
    return found
