"""The datasheet of a camera: the tables of all effects, checked when it is read."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Self, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import (
    AfterValidator,
    Field,
    PrivateAttr,
    ValidationError,
    create_model,
    model_validator,
)

from ..core import Doubt, Exposure, InputError, nearest, refuse_masked, warn_of
from ..core.errors import shown
from ..stages.chain import ORDER, chain, check_added, whole_chain
from ..stages.combined_readouts import CombinedReadouts
from ..stages.datasheet import CameraTable, FileTable, PixelGeometry, SensorSection, optional
from ..stages.gains import gain_dn_per_e
from ..stages.stage import Chain, Stage, converter_of
from ..stages.usual_range import warn_of_temperature
from .companding import CompandingSection
from .datasheet_checks import CHECKS, checked_source, noise_sources, with_checked_sources
from .datasheet_errors import did_you_mean, doubts, faults, fields_of, key_meant, unknown_field
from .field_catalogue import camera_file
from .figures import EmvaFigures, emva_figures, saturation_e
from .filters import band_seen_nm, filter_numbers, qe_of_filters
from .gain_ladder import Gains, at_gain, gain_notes, replaced_gain_notes, require_sense_gain
from .lens_datasheet import LensSection, lens_notes
from .notebook import camera_html
from .readouts import (
    CombineSection,
    Readout,
    camera_of_readout,
    combined_readouts,
    readout_cameras,
    readout_notes,
)

SET_BY_USER, SET_BY_SCENE = "set by the user", "set by the scene file"
SHORT = Exposure(0.0)
QE_CURVES = "quantum_efficiency.curves"  # the other ways of giving the QE become curves
QE_FIELDS = "quantum_efficiency.value", "quantum_efficiency.file", QE_CURVES
GAIN = "readout.gain_dn_per_e"
ALTERNATIVES = QE_FIELDS, (GAIN, "adc.full_scale_v")
"""Groups of fields that exclude each other: setting one unsets the others."""


def _table(
    name: str, description: str, base: type[CameraTable] = CameraTable
) -> type[CameraTable]:
    """Return the table of this name with the fields of all its effects, in the order of the chain."""
    kinds = dict.fromkeys(
        effect.fields for effect in ORDER if effect.fields is not None and effect.table == name
    )
    bases: Any = (*reversed(kinds), base)  # pydantic takes the fields of the last base first
    title = f"{name.title().replace('_', '')}Table"  # its name in this module, for pickle
    return cast(type[CameraTable], create_model(title, __base__=bases, __doc__=description))


if TYPE_CHECKING:
    PixelTable: TypeAlias = PixelGeometry
    QuantumEfficiencyTable: TypeAlias = CameraTable
    DarkCurrentTable: TypeAlias = CameraTable
    SourceFollowerTable: TypeAlias = CameraTable
    ReadoutTable: TypeAlias = CameraTable
    AdcTable: TypeAlias = CameraTable
else:
    PixelTable = _table("pixel", "One pixel.", PixelGeometry)
    QuantumEfficiencyTable = _table(
        "quantum_efficiency", "Electrons per photon, and colour filters."
    )
    DarkCurrentTable = _table("dark_current", "Electrons generated without light.")
    SourceFollowerTable = _table("source_follower", "Noise and gain of the pixel amplifier.")
    ReadoutTable = _table("readout", "From charge to the voltage at the ADC.")
    AdcTable = _table("adc", "The analogue-to-digital converter (ADC).")


def _known_field(name: str) -> str:
    """Return the key of a source, which must be a camera field; else raise ValueError."""
    if name not in fields_of(Camera):
        raise ValueError(
            f"it is not a field of a camera.{did_you_mean(name, fields_of(Camera))}"
        )
    return name


class Camera(FileTable):
    """A camera as described by its datasheet. Immutable; :meth:`replace` returns a changed and checked copy.

    ::

        camera = ms.load_camera("bayer_2mp").replace(**{"adc.bits": 10, "pixel.prnu": 0.005})
        quiet = camera.without("temporal_row_noise")
        print(camera.system_gain_dn_per_e)
    """

    name: str = Field(description="name of the camera", examples=["konnik_table1"])
    description: str = optional("one-line description", "the sensor of the paper", "")
    gain: str | None = optional(
        "gain setting that all other numbers belong to; camera.at_gain writes it", "800"
    )
    sensor: Annotated[SensorSection, AfterValidator(with_checked_sources)]
    pixel: PixelTable
    quantum_efficiency: QuantumEfficiencyTable
    dark_current: DarkCurrentTable
    source_follower: SourceFollowerTable
    readout: ReadoutTable
    adc: AdcTable
    lens: LensSection = Field(default_factory=LensSection)
    gains: Gains = optional(
        "gain settings; camera.at_gain or --gain selects one",
        [{"iso": 800, "gain_dn_per_e": 0.25, "read_noise_e": 3.0}],
        (),
    )
    readouts: tuple[Readout, ...] = optional(
        "readouts of every pixel, most sensitive first; the table combine joins them into one code",
        [{"name": "high", "fields": {"readout.gain_dn_per_e": 1.4}}],
        (),
    )
    combine: CombineSection = Field(default_factory=CombineSection)
    companding: CompandingSection = Field(default_factory=CompandingSection)
    sources: dict[Annotated[str, AfterValidator(_known_field)], str] = optional(
        "dotted field → source of its number",
        {"adc.bits": "Konnik & Welsh 2014, Table 1"},
        {},
    )
    _added: tuple[tuple[str, Stage], ...] = PrivateAttr(())

    @model_validator(mode="after")
    def _tables_fit(self) -> Camera:
        if error := next((text for check in CHECKS for text in check(self)), ""):
            raise ValueError(error)
        return self

    def __repr__(self) -> str:
        """``<Camera: bayer_2mp, CMOS, 1200 × 1920 pixels of 5.86 µm, 12 bit>``."""
        sensor, pitch = self.sensor, f"{self.pixel.pitch_x_um:g}"
        if self.pixel.pitch_y_um != self.pixel.pitch_x_um:
            pitch += f" × {self.pixel.pitch_y_um:g}"
        end = f"{self.code_bits} bit" + (f", gain {self.gain}" if self.gain else "")
        size = f"{sensor.rows} × {sensor.columns} pixels of {pitch} µm"
        return f"<Camera: {self.name}, {sensor.technology.upper()}, {size}, {end}>"

    __str__ = __repr__

    def replace(self, **changes: Any) -> Camera:
        """Return a copy with changed fields: ``camera.replace(**{"adc.bits": 14})``. None unsets a field.

        An unset field returns to its default: ``{"source_follower.white_nv_per_rthz": None,
        "source_follower.read_noise_e": 3}`` replaces read noise in volts by read noise in electrons. Raises InputError.
        """
        data, known = self.model_dump(), fields_of(Camera)
        unset = dict.fromkeys(
            other
            for fields in ALTERNATIVES
            if any(changes.get(field) is not None for field in fields)
            for other in fields
            if other not in changes
        )
        for dotted, given in {**unset, **changes}.items():
            refuse_masked(dotted, given)
            value = given.tolist() if isinstance(given, np.ndarray | np.generic) else given
            if dotted == "gain" and value is not None:
                raise InputError(
                    f"gain {value!r} would keep the numbers of another setting; use camera.at_gain({value!r})."
                )
            if dotted not in known:
                meant = key_meant(dotted, known)
                raise InputError(
                    unknown_field(tuple(dotted.split(".")), meant, Camera, "camera")
                )
            *path, last = dotted.split(".")
            table = data
            for name in path:
                table[name] = table = table.get(name) or {}
            table[last] = value
            if value is None:
                del table[last]
            data["sources"] = {
                key: source
                for key, source in data["sources"].items()
                if not f"{key}.".startswith(f"{dotted}.")
            }
            if path and value is not None:
                data["sources"][QE_CURVES if dotted in QE_FIELDS else dotted] = SET_BY_USER
        is_k_replaced = GAIN in unset and self.readout.gain_dn_per_e is not None
        is_k_replaced &= "readout" not in changes
        if is_k_replaced:
            require_sense_gain(self, data)
        camera = checked_camera(data, self.name)
        camera._added = self._added
        if is_k_replaced:
            warn_of(replaced_gain_notes(self, camera))
        return camera

    def at_gain(self, setting: float | str | None) -> Camera:
        """Return the camera at a gain setting: ``camera.at_gain(800)``, ``camera.at_gain("high conversion gain")``.

        The setting's overall system gain, read noise and other numbers (see ``cameras show``) replace the camera's;
        the full scale of the ADC follows from the gain. Row and column offsets keep their volts. All settings share
        the fixed patterns but not the temporal noise. A setting of None, or the present one, returns the camera
        unchanged. Raises InputError for an unknown setting.
        """
        return self if setting is None else at_gain(self, setting)

    def with_stage(self, stage: Stage, *, after: str) -> Camera:
        """Return the camera with your stage in its chain: ``camera.with_stage(Banding(...), after="reset_noise")``.

        after : key of the stage before it (the class name in small letters), even if this camera does not use it.
        Raises InputError for an unknown place, for a stage with the wrong output unit, and for a stage that draws from
        the noise source of another stage.
        """
        places = {effect.key(): effect for effect in ORDER[:-1]}
        if not isinstance(stage, Stage):
            raise InputError(
                f"stage is {shown(stage)}; pass an instance of a subclass of mitsuba_sensor.Stage."
            )
        if not isinstance(after, str) or after not in places:
            raise InputError(
                f"after is {shown(after)}; it must be one of {', '.join(places)}.{nearest(str(after), places)}"
            )
        if stage.domain != places[after].domain:
            raise InputError(
                f"{type(stage).__name__} returns {stage.domain}, but {after} returns {places[after].domain}; insert it "
                f"after another stage, or set its domain to {places[after].domain!r}."
            )
        camera = self.model_copy()
        camera._added = (*self._added, (after, stage))
        first = next(iter(camera.readout_cameras.values()), camera)
        check_added(whole_chain(first), stage, sum(camera.band_nm) / 2)
        return camera

    def without(self, *names: str) -> Camera:
        """Return the camera with these noise sources switched off: ``camera.without("shot_noise", "prnu")``.

        names : keys of stages, as plan and noise budget print them, including stages of :meth:`with_stage`. The other
            sources draw the same random numbers as before; gains and black level do not change.
            ``replace(**{"sensor.without": None})`` switches all sources on again.
        Raises InputError for any other name.
        """
        added = {stage.key() for stage in self.added}
        off = {checked_source(name, added) for name in names}
        without = (*self.sensor.without, *(name for name in noise_sources() if name in off))
        camera = self.replace(**{"sensor.without": without}) if off else self.model_copy()
        camera._added = tuple(place for place in self._added if place[1].key() not in off)
        return camera

    def model_copy(
        self, *, update: Mapping[str, Any] | None = None, deep: bool = False
    ) -> Self:
        """Return an unchecked copy, as Pydantic does, without cached results; :meth:`replace` checks the values."""
        camera = super().model_copy(update=update, deep=deep)
        for cached in (
            "stages",
            "notes",
            "readout_cameras",
            "combined_readouts",
            "saturation_e",
        ):
            vars(camera).pop(cached, None)
        return camera

    def to_dict(self) -> dict[str, Any]:
        """Return the datasheet with sources, added stages and notes, for the metadata of a frame."""
        record = {**self.model_dump(), "sources": dict(self.sources)}
        if self._added:
            record["added_stages"] = [{"after": a, "stage": repr(x)} for a, x in self._added]
        return {**record, "notes": list(self.notes)} if self.notes else record

    def to_toml(self) -> str:
        """Return the text of a camera file that explains every key. Raises InputError if stages were added."""
        return camera_file(self)

    def _repr_html_(self) -> str:
        return camera_html(self)

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """Notes on unusual values of the datasheet; each begins with its field."""
        unusual = [Doubt(text) for _, text in doubts(self.model_dump(), Camera)]
        of_effects = [effect.fields or FileTable for effect in ORDER]
        return (
            *unusual,
            *lens_notes(self.lens),
            *(note for fields in of_effects for note in fields.notes_of(self)),
            *gain_notes(self),
            *readout_notes(self),
        )

    @property
    def added(self) -> tuple[Stage, ...]:
        """Stages added by :meth:`with_stage`."""
        return tuple(stage for _, stage in self._added)

    def added_after(self, key: str) -> tuple[Stage, ...]:
        """Return the stages that :meth:`with_stage` added after this one."""
        return tuple(stage for after, stage in self._added if after == key)

    @cached_property
    def stages(self) -> Chain:
        """Signal chain from photons to digital numbers."""
        return chain(self)

    @cached_property
    def readout_cameras(self) -> Mapping[str, Camera]:
        """Readout name → camera with the fields of this readout and no other readouts."""
        return readout_cameras(self)

    @cached_property
    def combined_readouts(self) -> CombinedReadouts:
        """Stage that combines several readouts into one code."""
        return combined_readouts(self)

    def at_readout(self, name: str) -> Camera:
        """Return the camera with a single readout: ``camera.at_readout("high")``. Raises InputError."""
        return camera_of_readout(self, name)

    @property
    def code_bits(self) -> int:
        """Bits of the ADC, or of the linear code of several readouts."""
        return int(self.combine.bits if self.readouts else self.adc.bits)

    @property
    def system_gain_dn_per_e(self) -> float:
        """Overall system gain K of EMVA 1288 for small signals [DN/e-]."""
        return gain_dn_per_e(self)

    @property
    def black_level_dn(self) -> float:
        """Black level [DN]: adc.black_level_dn or, if unset, 4σ of the noise at zero exposure."""
        return float(converter_of(self.stages).black_level_dn)

    @cached_property
    def saturation_e(self) -> float:
        """Electrons of light and dark current at which a pixel saturates. Raises InputError if it saturates in the
        dark."""
        return saturation_e(self)

    def emva1288(self, exposure: Exposure = SHORT) -> EmvaFigures:
        """Return K, σ_d, saturation, SNR_max and dynamic range of EMVA 1288, computed from the datasheet.

        exposure : sets the dark signal; by default it is zero. Raises InputError if the dark signal saturates the ADC.
        """
        figures = emva_figures(self, exposure)
        warn_of_temperature(exposure.temperature_k)
        return figures

    @property
    def filter_names(self) -> tuple[str, ...]:
        """Names of the colour filters; a single name for a monochrome camera."""
        return tuple(self.quantum_efficiency.curves)

    @property
    def tile(self) -> tuple[tuple[int, ...], ...]:
        """Filter numbers of the repeating tile, by rows."""
        return tuple(self.quantum_efficiency.filter_tile)

    @property
    def band_nm(self) -> tuple[float, float]:
        """First and last wavelength that any filter detects [nm]."""
        return band_seen_nm(self.quantum_efficiency)

    def qe(
        self, wavelengths_nm: ArrayLike, bandwidths_nm: ArrayLike | None = None
    ) -> NDArray[np.float64]:
        """Return the quantum efficiency of every filter at (B,) wavelengths, shape (F, B).

        bandwidths_nm : average over bands of these widths, weighted by the photons of a flat spectrum. Polarisers
            reduce the QE to its value for unpolarised light.
        """
        return qe_of_filters(self, wavelengths_nm, bandwidths_nm)

    def filter_index(
        self, shape: tuple[int, int], origin: tuple[int, int] = (0, 0)
    ) -> NDArray[np.intp]:
        """Return the filter number of every pixel of a window, shape (H, W)."""
        return filter_numbers(self.tile, shape, origin)


def with_fields_of(camera: Camera, changes: Mapping[str, Any], source: str) -> Camera:
    """Return ``camera.replace(**changes)`` for values that no user typed.  source : their source."""
    if not changes:
        return camera
    changed = camera.replace(**changes)
    sources = dict(changed.sources)
    for name in (*changes, QE_CURVES):
        if sources.get(name) == SET_BY_USER != camera.sources.get(name):
            sources[name] = source
    return changed.model_copy(update={"sources": sources})


def checked_camera(data: dict[str, Any], where: str, folder: str | None = None) -> Camera:
    """Return the camera of these tables. Raises InputError.

    where : begins the message of an error.  folder : of the file; None for changes of a camera.
    """
    try:
        return Camera.model_validate(data, context={"folder": folder or "."})
    except ValidationError as error:
        errors, more = faults(error, Camera), ""
        if folder is None and "not both" in errors[0].text:
            more = " None unsets a field."
        elif folder is not None and len(errors) > 1:
            more = f" ms.check_camera lists all {len(errors)} errors."
        raise InputError(f"{where}: {errors[0].text}{more}") from None
