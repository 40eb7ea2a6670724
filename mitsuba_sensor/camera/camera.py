"""The datasheet of a camera: the tables of the effects put together, checked once when it is read."""

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

from ..core import Doubt, Exposure, InputError, nearest, refuse_masked
from ..stages.chain import ORDER, chain, check_added, whole_chain
from ..stages.combined_readouts import CombinedReadouts
from ..stages.datasheet import CameraTable, FileTable, PixelGeometry, SensorSection, optional
from ..stages.gains import gain_dn_per_e
from ..stages.stage import Chain, Stage, converter_of
from ..stages.usual_range import warn_of_temperature
from .companding import CompandingSection
from .datasheet_checks import (
    checked_source,
    noise_sources,
    with_checked_sources,
    wrong_diffusion,
    wrong_gains,
    wrong_one_gain,
    wrong_polarizers,
    wrong_resets,
    wrong_technology,
)
from .datasheet_errors import did_you_mean, doubts, faults, fields_of
from .dual_pixels import wrong_dual_pixels
from .field_catalogue import camera_file
from .figures import EmvaFigures, emva_figures, saturation_e
from .filters import band_seen_nm, filter_numbers, qe_of_filters
from .gain_ladder import Gains, at_gain, gain_notes, wrong_gain
from .lens_datasheet import LensSection, lens_notes
from .notebook import camera_html
from .readouts import (
    CombineSection,
    Readout,
    camera_of_readout,
    combined_readouts,
    readout_cameras,
    readout_notes,
    wrong_readouts,
)

SET_BY_USER, SET_BY_SCENE = "set by the user", "set by the scene file"
SHORT = Exposure(0.0)
QE_CURVES = "quantum_efficiency.curves"  # what each way of giving the QE becomes
QE_WAYS = "quantum_efficiency.value", "quantum_efficiency.file", QE_CURVES
WAYS = QE_WAYS, ("readout.gain_dn_per_e", "adc.full_scale_v")
"""Fields of which one is given: setting it unsets the others."""
UNSET = " None unsets a field; on the command line: --set FIELD=none."

CHECKS = (
    wrong_technology,
    wrong_diffusion,
    wrong_polarizers,
    wrong_dual_pixels,
    wrong_one_gain,
    wrong_resets,
    wrong_readouts,
    wrong_gains,
    wrong_gain,
)
"""Cross-checks of a datasheet, whose first sentence refuses it."""


def _table(
    name: str, description: str, base: type[CameraTable] = CameraTable
) -> type[CameraTable]:
    """The table of this name with the fields of every effect that belong there, in the order of the chain."""
    kinds = dict.fromkeys(
        effect.fields for effect in ORDER if effect.fields is not None and effect.table == name
    )
    bases: Any = (*reversed(kinds), base)  # pydantic takes the fields of the last base first
    title = f"{name.title().replace('_', '')}Table"  # the name that it has in this module, where pickle looks for it
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
        "quantum_efficiency", "Electrons per photon, and the colour filters."
    )
    DarkCurrentTable = _table("dark_current", "Electrons that come without light.")
    SourceFollowerTable = _table("source_follower", "Noise and gain of the pixel's amplifier.")
    ReadoutTable = _table("readout", "From charge to the voltage that the converter measures.")
    AdcTable = _table("adc", "The analogue-to-digital converter.")


def _known_field(name: str) -> str:
    """The key of a source, which must be a field of a camera."""
    if name not in fields_of(Camera):
        meant = did_you_mean(name, fields_of(Camera))
        raise ValueError(f"{name!r} is no field of a camera.{meant}".removesuffix("."))
    return name


class Camera(FileTable):
    """A camera as its datasheet describes it. Immutable; :meth:`replace` makes another one, checked again.

    ::

        camera = ms.load_camera("bayer_2mp").replace(**{"adc.bits": 10, "pixel.prnu": 0.005})
        quiet = camera.without("temporal_row_noise")
        print(camera.system_gain_dn_per_e)
    """

    name: str = Field(description="how the camera is called", examples=["konnik_table1"])
    description: str = optional("one line for people", "the sensor of the paper", "")
    gain: str | None = optional(
        "the setting of gains that all other numbers hold for, as at_gain writes it", "800"
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
        "gain settings, from which --gain and camera.at_gain choose one",
        [{"iso": 800, "gain_dn_per_e": 0.25, "read_noise_e": 3.0}],
        (),
    )
    readouts: tuple[Readout, ...] = optional(
        "read-outs of every pixel, the most sensitive first, that the table combine joins to one code",
        [{"name": "high", "fields": {"readout.gain_dn_per_e": 1.4}}],
        (),
    )
    combine: CombineSection = Field(default_factory=CombineSection)
    companding: CompandingSection = Field(default_factory=CompandingSection)
    sources: dict[Annotated[str, AfterValidator(_known_field)], str] = optional(
        "dotted field → where its number comes from",
        {"adc.bits": "Konnik & Welsh 2014, Table 1"},
        {},
    )
    _added: tuple[tuple[str, Stage], ...] = PrivateAttr(())

    @model_validator(mode="after")
    def _tables_fit(self) -> Camera:
        if wrong := next((one for check in CHECKS for one in check(self)), ""):
            raise ValueError(wrong)
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
        """A copy with dotted fields changed: ``camera.replace(**{"adc.bits": 14})``; None unsets a field.

        An unset field has its default again, or is left out: ``{"source_follower.white_nv_per_rthz": None,
        "source_follower.read_noise_e": 3}`` gives the read noise in electrons instead. Raises InputError.
        """
        data, known = self.model_dump(), fields_of(Camera)
        unset = dict.fromkeys(
            other
            for ways in WAYS
            if any(changes.get(way) is not None for way in ways)
            for other in ways
            if other not in changes
        )
        for dotted, given in {**unset, **changes}.items():
            refuse_masked(dotted, given)
            value = given.tolist() if isinstance(given, np.ndarray | np.generic) else given
            if dotted == "gain" and value is not None:
                raise InputError(
                    f"gain is to be {value!r}, and its numbers too; take camera.at_gain({value!r}), or --gain {value}."
                )
            if dotted not in known:
                raise InputError(
                    f"{dotted} is not a field of a camera.{did_you_mean(dotted, known)}"
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
                data["sources"][QE_CURVES if dotted in QE_WAYS else dotted] = SET_BY_USER
        camera = checked_camera(data, self.name)
        camera._added = self._added
        return camera

    def at_gain(self, setting: float | str | None) -> Camera:
        """The camera at one of its gain settings: ``camera.at_gain(800)``, ``camera.at_gain("high conversion gain")``.

        Overall system gain, read noise and what else the setting has (see ``cameras show``) take the place of the
        camera's own; the converter's full scale makes the gain. Offsets of rows and columns keep their volts. Fixed
        patterns are the same at every setting, temporal noise is another. A camera that is there already is returned as
        it is, and so is one where the setting is None. Raises InputError for a setting that it does not have.
        """
        return self if setting is None else at_gain(self, setting)

    def with_stage(self, stage: Stage, *, after: str) -> Camera:
        """The same camera with a stage of yours in its chain: ``camera.with_stage(Banding(...), after="reset_noise")``.

        after : key of the stage in front of it (the class name in small letters), whether this camera has it or not.
        Raises InputError for an unknown place, where the stage does not deliver the unit that is expected there, and
        where it draws from the noise source of another stage.
        """
        places = {effect.key(): effect for effect in ORDER[:-1]}
        if not isinstance(stage, Stage):
            raise InputError(
                f"stage is {stage!r}; pass an instance of a class derived from mitsuba_sensor.Stage."
            )
        if not isinstance(after, str) or after not in places:
            raise InputError(
                f"after is {after!r}; it must be one of {', '.join(places)}.{nearest(str(after), places)}"
            )
        if stage.domain != places[after].domain:
            raise InputError(
                f"{type(stage).__name__} delivers {stage.domain}, and behind {after} are {places[after].domain}; "
                f"put it after another stage, or set its domain to {places[after].domain!r}."
            )
        camera = self.model_copy()
        camera._added = (*self._added, (after, stage))
        one = next(iter(camera.readout_cameras.values()), camera)
        check_added(whole_chain(one), stage, sum(camera.band_nm) / 2)
        return camera

    def without(self, *names: str) -> Camera:
        """The same camera with these noise sources switched off: ``camera.without("shot_noise", "prnu")``.

        names : keys of stages, as plan and noise budget print them; those of :meth:`with_stage` too. All others draw
            the same random numbers as before, and gains and black level stay. ``replace(**{"sensor.without": None})``
            switches all of them on again.
        Raises InputError for a name that is none, and for a stage that is no noise.
        """
        added = {stage.key() for stage in self.added}
        off = {checked_source(name, added) for name in names}
        known = (*self.sensor.without, *(name for name in noise_sources() if name in off))
        camera = self.replace(**{"sensor.without": known}) if off else self.model_copy()
        camera._added = tuple(one for one in self._added if one[1].key() not in off)
        return camera

    def model_copy(
        self, *, update: Mapping[str, Any] | None = None, deep: bool = False
    ) -> Self:
        """A copy, as of every pydantic model, with a chain of its own; :meth:`replace` checks the values too."""
        camera = super().model_copy(update=update, deep=deep)
        for made in ("stages", "notes", "readout_cameras", "combined_readouts", "saturation_e"):
            vars(camera).pop(made, None)
        return camera

    def to_dict(self) -> dict[str, Any]:
        """The datasheet, the source of each number, and the stages that were added: for the metadata of a frame."""
        found = {**self.model_dump(), "sources": dict(self.sources)}
        if self._added:
            found["added_stages"] = [{"after": a, "stage": repr(one)} for a, one in self._added]
        return {**found, "notes": list(self.notes)} if self.notes else found

    def to_toml(self) -> str:
        """The text of a camera file with every key explained. Raises InputError for stages that a user added."""
        return camera_file(self)

    def _repr_html_(self) -> str:
        return camera_html(self)

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """Sentences about values of the datasheet that are allowed and may surprise; each begins with its field."""
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
        """The stages that :meth:`with_stage` added."""
        return tuple(stage for _, stage in self._added)

    def added_after(self, key: str) -> tuple[Stage, ...]:
        """The stages that :meth:`with_stage` put behind this one."""
        return tuple(stage for after, stage in self._added if after == key)

    @cached_property
    def stages(self) -> Chain:
        """The signal chain of this camera, from photons to digital numbers."""
        return chain(self)

    @cached_property
    def readout_cameras(self) -> Mapping[str, Camera]:
        """The camera of each read-out by its name: this one with the fields of the read-out, and no others."""
        return readout_cameras(self)

    @cached_property
    def combined_readouts(self) -> CombinedReadouts:
        """Of a camera with several read-outs the stage that makes one code of them."""
        return combined_readouts(self)

    def at_readout(self, name: str) -> Camera:
        """The camera with one of its read-outs alone: ``camera.at_readout("high")``. Raises InputError."""
        return camera_of_readout(self, name)

    @property
    def code_bits(self) -> int:
        """Bits of its codes: of the converter, or of the linear code of several read-outs."""
        return int(self.combine.bits if self.readouts else self.adc.bits)

    @property
    def system_gain_dn_per_e(self) -> float:
        """EMVA 1288's overall system gain K of small signals [DN/e-]."""
        return gain_dn_per_e(self)

    @property
    def black_level_dn(self) -> float:
        """Black level of its frames [DN]: adc.black_level_dn, or 4σ of the noise of a zero exposure if not given."""
        return float(converter_of(self.stages).black_level_dn)

    @cached_property
    def saturation_e(self) -> float:
        """Electrons of light and dark current at which a pixel saturates. Raises InputError if darkness does it."""
        return saturation_e(self)

    def emva1288(self, exposure: Exposure = SHORT) -> EmvaFigures:
        """EMVA 1288's K, σ_d, saturation, SNR_max and dynamic range, from the datasheet by the theory of the frames.

        exposure : whose dark current counts; by default so short that there is none. Raises InputError where darkness
            is at the highest code.
        """
        figures = emva_figures(self, exposure)
        warn_of_temperature(exposure.temperature_k)
        return figures

    @property
    def filter_names(self) -> tuple[str, ...]:
        """Names of the colour filters; one for a monochrome camera."""
        return tuple(self.quantum_efficiency.curves)

    @property
    def tile(self) -> tuple[tuple[int, ...], ...]:
        """Rows of filter numbers that repeat over the sensor."""
        return tuple(self.quantum_efficiency.filter_tile)

    @property
    def band_nm(self) -> tuple[float, float]:
        """From the first to the last wavelength at which any filter sees anything [nm]."""
        return band_seen_nm(self.quantum_efficiency)

    def qe(
        self, wavelengths_nm: ArrayLike, bandwidths_nm: ArrayLike | None = None
    ) -> NDArray[np.float64]:
        """Quantum efficiency of every filter at (B,) wavelengths, (F, B); or averaged over bands, weighted by photons
        of a flat spectrum. With polarisers that of unpolarised light behind them."""
        return qe_of_filters(self, wavelengths_nm, bandwidths_nm)

    def filter_index(
        self, shape: tuple[int, int], origin: tuple[int, int] = (0, 0)
    ) -> NDArray[np.intp]:
        """Filter number of every pixel of a window, (H, W)."""
        return filter_numbers(self.tile, shape, origin)


def with_fields_of(camera: Camera, changes: Mapping[str, Any], source: str) -> Camera:
    """``camera.replace(**changes)`` for values that no user typed.  source : what is said of where they come from."""
    if not changes:
        return camera
    changed = camera.replace(**changes)
    sources = dict(changed.sources)
    for name in (*changes, QE_CURVES):
        if sources.get(name) == SET_BY_USER != camera.sources.get(name):
            sources[name] = source
    return changed.model_copy(update={"sources": sources})


def checked_camera(data: dict[str, Any], where: str, folder: str | None = None) -> Camera:
    """The camera of these tables. Raises InputError.

    where : for what is said of an error.  folder : that of a file; None for changes of a camera.
    """
    try:
        return Camera.model_validate(data, context={"folder": folder or "."})
    except ValidationError as error:
        found, more = faults(error, Camera), ""
        if folder is None and found[0].kind == "value_error" and found[0].loc:
            more = UNSET
        elif folder is not None and len(found) > 1:
            more = f" It is the first of {len(found)} errors; `cameras check` or check_camera lists them."
        raise InputError(f"{where}: {found[0].text}{more}") from None
