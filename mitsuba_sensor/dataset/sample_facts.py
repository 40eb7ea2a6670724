"""What readers need of sample.json, which other programs may have written."""

from __future__ import annotations

from typing import Annotated, Any, Self

from pydantic import BaseModel, Field, model_validator


class _Image(BaseModel):
    columns: int
    rows: int
    frames: int
    exposure_s: float
    temperature_k: float
    black_level_dn: float
    white_level_dn: float
    origin: tuple[int, int]


class _Exposure(BaseModel):
    ev: float


class _Pixel(BaseModel):
    pitch_x_um: float


class _Camera(BaseModel):
    pixel: _Pixel


class _Config(BaseModel):
    camera: _Camera
    gain: str | float | None
    exposure: _Exposure


class _View(BaseModel):
    key: str
    scene: str
    config: dict[str, Any]


class _Metering(BaseModel):
    exposure_s: float


class _Heights(BaseModel):
    ideal: list[float]
    real: list[float]


_Row = tuple[float, float, float]


class _Intrinsics(BaseModel):
    matrix: tuple[_Row, _Row, _Row] | None
    image_size: tuple[int, int]
    distortion: tuple[float, float, float, float, float] | None
    heights_mm: _Heights | None

    @model_validator(mode="after")
    def _has_a_lens(self) -> Self:
        if self.matrix and not self.distortion and not self.heights_mm:
            raise ValueError("neither distortion nor heights_mm")
        return self


class _Light(BaseModel):
    noise_ratio_median: float | None
    metering: _Metering | None
    intrinsics: _Intrinsics
    camera_to_world: list[list[float]] | None


class _Readout(BaseModel):
    name: str
    overall_system_gain_dn_per_e: float
    black_level_dn: float
    white_level_dn: float


Quantiles = Annotated[list[float], Field(min_length=5, max_length=5)]


class SampleFacts(BaseModel):
    """What readers need of sample.json; other entries are ignored."""

    key: str
    camera: str
    image: _Image
    config: _Config
    view: _View
    light: _Light
    readouts: list[_Readout] | None
    system_gain_dn_per_e: float
    digital_quantiles_dn: Quantiles
    electrons_quantiles_e: Quantiles
    versions: dict[str, str | None]
