"""Fields that are given in one of several ways: setting one of them takes the others out."""

from __future__ import annotations

from collections.abc import Collection

QE_WAYS = ("value", "file", "curves")
QE_CURVES = "quantum_efficiency.curves"  # what each way of giving the QE becomes
GAIN_WAYS = ("readout.gain_dn_per_e", "adc.full_scale_v")


def leave_other_ways(
    data: dict[str, dict[str, object]], dotted: str, value: object, changes: Collection[str]
) -> None:
    """Take the other ways of giving the QE or the gain out of the tables, unless they are changed too.

    data : tables of a camera, changed in place.  dotted, value : the field that is set.  changes : all that are.
    """
    if value is None:
        return
    ways: tuple[str, ...] = GAIN_WAYS
    if dotted.startswith("quantum_efficiency."):
        ways = tuple(f"quantum_efficiency.{way}" for way in QE_WAYS)
    if dotted not in ways:
        return
    for other in ways:
        if other != dotted and other not in changes:
            table, key = other.split(".")
            data[table].pop(key, None)
            data["sources"].pop(other, None)
