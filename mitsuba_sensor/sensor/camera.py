"""The datasheet of a camera: the tables of the effects put together, checked once when it is read."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, Self, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import AfterValidator, Field, PrivateAttr, ValidationError, create_model, model_validator

from ..core import InputError, nearest
from ..core.band_average import photon_averages
from .chain import ORDER, chain, check_added
from .datasheet import CameraTable, FileTable, PixelGeometry, SensorSection
from .datasheet_checks import check_gains, check_technology
from .datasheet_errors import doubts, faults, fields_of
from .lens_datasheet import LensSection
from .stage import Chain, Stage

QE_WAYS = ("value", "file", "curves")
UNSET = " None unsets a field; on the command line: --set FIELD=none."
SHIPPED = resources.files(__package__) / "cameras"


def _table(name: str, description: str, base: type[CameraTable] = CameraTable) -> type[CameraTable]:
    """The table of this name with the fields of every effect that belong there, in the order of the chain."""
    kinds = dict.fromkeys(effect.fields for effect in ORDER if effect.fields is not None and effect.table == name)
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
    QuantumEfficiencyTable = _table("quantum_efficiency", "Electrons per photon, and the colour filters.")
    DarkCurrentTable = _table("dark_current", "Electrons that come without light.")
    SourceFollowerTable = _table("source_follower", "Noise and gain of the pixel's amplifier.")
    ReadoutTable = _table("readout", "From charge to the voltage that the converter measures.")
    AdcTable = _table("adc", "The analogue-to-digital converter.")


def _known_field(name: str) -> str:
    """The key of a source, which must be a field of a camera."""
    if name not in fields_of(Camera):
        raise ValueError(f"{name!r} is no field of a camera.{nearest(name, fields_of(Camera))}".removesuffix("."))
    return name


class Camera(FileTable):
    """A camera as its datasheet describes it. Immutable; :meth:`replace` makes another one, checked again."""

    name: str = Field(description="how the camera is called", examples=["konnik_table1"])
    description: str = Field("", description="one line for people", examples=["the sensor of the paper"])
    sensor: SensorSection
    pixel: PixelTable
    quantum_efficiency: QuantumEfficiencyTable
    dark_current: DarkCurrentTable
    source_follower: SourceFollowerTable
    readout: ReadoutTable
    adc: AdcTable
    lens: LensSection = Field(default_factory=LensSection)
    sources: dict[Annotated[str, AfterValidator(_known_field)], str] = Field(
        default_factory=dict,
        description="dotted field → where its number comes from",
        examples=[{"adc.bits": "Konnik & Welsh 2014, Table 1"}],
    )
    _added: tuple[tuple[str, Stage], ...] = PrivateAttr(())

    @model_validator(mode="after")
    def _tables_fit(self) -> Camera:
        check_technology(self)
        check_gains(self)
        return self

    def replace(self, **changes: Any) -> Camera:
        """A copy with dotted fields changed: ``camera.replace(**{"adc.bits": 14})``; None unsets a field.

        An unset field has its default again, or is left out: ``{"source_follower.white_nv_per_rthz": None,
        "source_follower.read_noise_e": 3}`` gives the read noise in electrons instead. Raises InputError.
        """
        data, known = self.model_dump(), fields_of(Camera)
        for dotted, value in changes.items():
            if dotted not in known:
                raise InputError(f"{dotted} is not a field of a camera.{nearest(dotted, known)}")
            *path, last = dotted.split(".")
            table = data
            for name in path:
                table[name] = table = table.get(name) or {}
            table[last] = value
            if value is None:
                del table[last]
            if path == ["quantum_efficiency"] and last in QE_WAYS and value is not None:
                for other in QE_WAYS:  # the new way of giving the QE stands in for the old one
                    if other != last and f"quantum_efficiency.{other}" not in changes:
                        table.pop(other, None)
            sources = data["sources"]
            data["sources"] = {key: x for key, x in sources.items() if not f"{key}.".startswith(f"{dotted}.")}
            if path and value is not None:
                data["sources"][dotted] = "set by the user"
        camera = _checked(data, self.name)
        camera._added = self._added
        return camera

    def with_stage(self, stage: Stage, *, after: str) -> Camera:
        """The same camera with a stage of yours in its chain: ``camera.with_stage(Banding(...), after="reset_noise")``.

        after : key of the stage in front of it (the class name in small letters), whether this camera has it or not.
        Raises InputError for an unknown place, where the stage does not deliver the unit that is expected there, and
        where it draws from the noise source of another stage.
        """
        places = {effect.key(): effect for effect in ORDER[:-1]}
        if not isinstance(stage, Stage):
            raise InputError(f"stage is {stage!r}; pass an instance of a class derived from mitsuba_sensor.Stage.")
        if not isinstance(after, str) or after not in places:
            raise InputError(f"after is {after!r}; it must be one of {', '.join(places)}.{nearest(str(after), places)}")
        if stage.domain != places[after].domain:
            raise InputError(
                f"{type(stage).__name__} delivers {stage.domain}, and behind {after} are {places[after].domain}; "
                f"put it after another stage, or set its domain to {places[after].domain!r}."
            )
        camera = self.model_copy()
        camera._added = (*self._added, (after, stage))
        check_added(camera.stages, stage, sum(camera.band_nm) / 2)
        return camera

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy, as of every pydantic model, with a chain of its own; :meth:`replace` checks the values too."""
        camera = super().model_copy(update=update, deep=deep)
        vars(camera).pop("stages", None)
        return camera

    def to_dict(self) -> dict[str, Any]:
        """The datasheet, the source of each number, and the stages that were added: for the metadata of a frame."""
        added = [{"after": after, "stage": repr(stage)} for after, stage in self._added]
        extra = {"added_stages": added, "notes": list(self.notes)}
        return {**self.model_dump(), "sources": dict(self.sources), **{name: x for name, x in extra.items() if x}}

    def to_toml(self) -> str:
        """The text of a camera file that loads again to an equal camera, with every key that there is explained.

        Raises InputError for a camera with stages of :meth:`with_stage`, which no file can hold.
        """
        from .camera_toml import camera_file

        return camera_file(self)

    def _repr_html_(self) -> str:
        from .notebook import camera_html

        return camera_html(self)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about values of the datasheet that are allowed and may surprise; each begins with its field."""
        unusual = [text for _, text in doubts(self.model_dump(), Camera)]
        return (*unusual, *(note for effect in ORDER for note in effect.notes(self)))

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
        points = self.quantum_efficiency.wavelengths_nm
        curves = self.quantum_efficiency.curves.values()
        seen = [i for i in range(len(points)) if any(curve[i] > 0 for curve in curves)] or [0, len(points) - 1]
        return points[max(seen[0] - 1, 0)], points[min(seen[-1] + 1, len(points) - 1)]

    def qe(self, wavelengths_nm: ArrayLike, bandwidths_nm: ArrayLike | None = None) -> NDArray[np.float64]:
        """Quantum efficiency of every filter at (B,) wavelengths, (F, B); or averaged over bands, weighted by photons
        of a flat spectrum."""
        points, curves = np.array(self.quantum_efficiency.wavelengths_nm), self.quantum_efficiency.curves.values()

        def at(nm: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.array([np.interp(nm, points, curve, 0.0, 0.0) for curve in curves])

        centres = np.asarray(wavelengths_nm, dtype=np.float64)
        if bandwidths_nm is None:
            return at(centres)
        return photon_averages(at, points, centres, np.asarray(bandwidths_nm, dtype=np.float64))

    def filter_index(self, shape: tuple[int, int], origin: tuple[int, int] = (0, 0)) -> NDArray[np.intp]:
        """Filter number of every pixel of a window, (H, W)."""
        tile = np.array(self.tile)
        rows = (np.arange(shape[0]) + origin[0]) % tile.shape[0]
        columns = (np.arange(shape[1]) + origin[1]) % tile.shape[1]
        return tile[np.ix_(rows, columns)]


def load_camera(name: str | Path) -> Camera:
    """A shipped camera by name (``konnik_table1``), or any camera file by path (``my.toml``).

    Raises InputError when there is no such camera or a field is wrong; :func:`check_camera` finds all that is wrong.
    """
    text, where, folder = camera_text(name)
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"The camera file {where} is not valid TOML: {error}.") from None
    return _checked(data, where, folder)


class CameraText(NamedTuple):
    """The text of a camera file, its name for messages, and the folder of files that it names."""

    text: str
    where: str
    folder: str = "."


def camera_text(name: str | Path) -> CameraText:
    """The file of a shipped camera by name, or any camera file by path. Raises InputError."""
    if not isinstance(name, str | Path):
        raise InputError(f"name is {name!r}; pass the name of a camera or the path of a .toml file.")
    shipped, path = list_cameras(), Path(name)
    if isinstance(name, str) and name in shipped:
        return CameraText((SHIPPED / f"{name}.toml").read_text("utf-8"), f"{name}.toml")
    if path.suffix != ".toml" and not (str(name) and path.exists()):
        raise InputError(
            f"{str(name)!r} is no camera that ships with mitsuba_sensor ({', '.join(shipped)}) and no .toml file."
            f"{nearest(str(name), shipped)}"
        )
    try:
        return CameraText(path.read_text("utf-8"), str(path), str(path.parent))
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise InputError(f"The camera file {path} cannot be read: {reason}.") from None


def camera_from(data: dict[str, Any], where: str) -> Camera:
    """The camera of these tables, as :meth:`Camera.model_dump` gives them.  where : for what is said of an error.

    Raises InputError.
    """
    return _checked(data, where)


def list_cameras() -> list[str]:
    """Names of the cameras that ship with the package."""
    return sorted(file.name.removesuffix(".toml") for file in SHIPPED.iterdir() if file.name.endswith(".toml"))


def camera_schema() -> dict[str, Any]:
    """JSON Schema of a camera file, for editors and other programs."""
    return Camera.model_json_schema()


def _checked(data: dict[str, Any], where: str, folder: str | None = None) -> Camera:
    """folder : that of a file; None for changes of a camera."""
    try:
        return Camera.model_validate(data, context={"folder": folder or "."})
    except ValidationError as error:
        found = faults(error, Camera)
        more = UNSET if folder is None and found[0].of_table else ""
        if folder is not None and len(found) > 1:
            more = f" It is the first of {len(found)} errors; `mitsuba-sensor cameras check` lists them all."
        raise InputError(f"{where}: {found[0].text}{more}") from None


def toml_value(text: str) -> Any:
    """A value as in a camera file: 14, 0.5, true, [1, 2]; None for none and for nothing; anything else is a text."""
    if text in ("", "none"):
        return None
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text
