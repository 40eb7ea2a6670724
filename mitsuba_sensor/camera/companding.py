"""Companding: a linear code to fewer bits by a table of knees, piecewise linear, and back."""

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
    """The code that leaves the sensor, by a table of knees."""

    bits: Annotated[int, Field(ge=2, le=16, strict=True)] = optional(
        "resolution of the companded code [bit]", 12, 12
    )
    knees: tuple[tuple[Code, Code], ...] = optional(
        "linear code and companded code at each knee, both rising from 0; straight lines between them; "
        "none: the code is not companded [DN]",
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
                f"knees begins with {list(knees[0])} and has {len(knees)}; give [0, 0] and one or more behind it"
            )
        for (linear, companded), (next_linear, next_companded) in pairwise(knees):
            if next_linear <= linear or next_companded <= companded:
                raise ValueError(
                    f"knees has [{next_linear}, {next_companded}] behind [{linear}, {companded}]; both codes rise"
                )
            if next_companded - companded > next_linear - linear:
                raise ValueError(
                    f"knees has {next_companded - companded} companded codes for {next_linear - linear} linear ones up "
                    f"to [{next_linear}, {next_companded}]; a line has at most as many"
                )
        if knees[-1][1] > highest:
            raise ValueError(
                f"knees ends at the companded code {knees[-1][1]}, and {self.bits} bits at {highest}; take more bits, "
                "or lower codes"
            )
        return self

    @property
    def _lines(self) -> tuple[Float64Array, Float64Array]:
        """Linear and companded codes of the knees."""
        linear, companded = np.array(self.knees, dtype=np.float64).T
        return linear, companded

    def compand(self, codes: NDArray[np.unsignedinteger]) -> NDArray[np.unsignedinteger]:
        """The companded codes of linear ones, rounded half up; linear codes beyond the last knee have its code."""
        linear, companded = self._lines
        found = np.floor(np.interp(codes.astype(np.float64), linear, companded) + 0.5)
        return found.astype(np.min_scalar_type(2**self.bits - 1))

    def linear_codes(self) -> Float64Array:
        """The linear code of every companded code, (2^bits,), not rounded: within half a step of each line."""
        linear, companded = self._lines
        return np.asarray(np.interp(np.arange(2.0**self.bits), companded, linear))

    def expand(self, codes: NDArray[np.unsignedinteger]) -> NDArray[np.uint32]:
        """Linear codes of companded ones, rounded half up."""
        table = np.floor(self.linear_codes() + 0.5).astype(np.uint32)
        return np.asarray(table[codes])
