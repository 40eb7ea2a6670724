"""Companding: a piecewise linear map from a linear code to fewer bits, and back."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ..core.types import Float64Array
from ..stages.datasheet import FileTable, optional

Code = Annotated[int, Field(ge=0, le=2**24 - 1, strict=True)]


class CompandingSection(FileTable):
    """The code that leaves the sensor, given by a table of knees."""

    bits: Annotated[int, Field(ge=2, le=16, strict=True)] = optional(
        "resolution of the companded code [bit]", 12, 12
    )
    knees: tuple[tuple[Code, Code], ...] = optional(
        "linear and companded code at each knee, both rising from 0; none: no companding [DN]",
        [[0, 0], [1023, 1023], [16383, 2559], [1048575, 4095]],
        (),
        title="companding, PWL compression, knee points",
    )

    @model_validator(mode="after")
    def _knees_rise(self) -> Self:
        knees, highest = self.knees, 2**self.bits - 1
        if not knees:
            return self
        if len(knees) < 2 or knees[0] != (0, 0):
            raise ValueError(
                f"knees has {len(knees)} knee(s) and starts with {list(knees[0])}; give [0, 0] and at least one more"
            )
        for (linear, companded), (next_linear, next_companded) in pairwise(knees):
            if next_linear <= linear or next_companded <= companded:
                raise ValueError(
                    f"knees has [{next_linear}, {next_companded}] after [{linear}, {companded}]; both codes must rise"
                )
            if next_companded - companded > next_linear - linear:
                raise ValueError(
                    f"knees has {next_companded - companded} companded codes for {next_linear - linear} linear codes "
                    f"before [{next_linear}, {next_companded}]; give at most as many"
                )
        if knees[-1][1] > highest:
            raise ValueError(
                f"knees ends at the companded code {knees[-1][1]}; it must be at most {highest} ({self.bits} bits): "
                "raise bits, or reduce the codes"
            )
        return self

    def compand(self, codes: NDArray[np.unsignedinteger]) -> NDArray[np.unsignedinteger]:
        """Return the companded codes, rounded half up; linear codes above the last knee are clipped."""
        linear, companded = np.array(self.knees, dtype=np.float64).T
        rounded = np.floor(np.interp(codes.astype(np.float64), linear, companded) + 0.5)
        return np.asarray(rounded, np.min_scalar_type(2**self.bits - 1))

    def linear_codes(self) -> Float64Array:
        """Return the unrounded linear code of every companded code, shape (2^bits,)."""
        linear, companded = np.array(self.knees, dtype=np.float64).T
        return np.asarray(np.interp(np.arange(2.0**self.bits), companded, linear))

    def expand(self, codes: NDArray[np.unsignedinteger]) -> NDArray[np.uint32]:
        """Return the linear codes of companded codes, rounded half up."""
        table = np.floor(self.linear_codes() + 0.5).astype(np.uint32)
        return np.asarray(table[codes])
