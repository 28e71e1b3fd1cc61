"""SUMO's floating car data: every vehicle is a candidate for the subject vehicle."""

import gzip
import itertools
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from jaxcalib.errors import CaseError, shorten
from jaxcalib.importers.importer import Imported, ImportOptions
from jaxcalib.importers.planes import slices_in_plane, utm_at
from jaxcalib.importers.trajectories import Recording, Slice
from jaxcalib.importers.virtual_probes import virtual_probes

ATTRIBUTES = ("id", "x", "y", "angle", "speed")  # of --fcd-output.attributes; acceleration is taken where it is there
SEPARATORS = (";", ",")  # of SUMO's CSV: its own, and that of --output.column-separator as most set it
STANDING_SHARE = 0.01  # of the way that speeds say: with less, places are degrees


def read_recording(source: Path, options: ImportOptions) -> Imported:
    """Make virtual probes of floating car data (--fcd-output, XML, CSV or Parquet, packed or not).

    The scenario is that which SUMO ran: positions are those of its network, times those of its clock.

    Raises:
        CaseError: it is no such file, a needed attribute is missing, or no scenario is given.
    """
    if options.config is None:
        raise CaseError(
            "command line", "--scenario", "expected the scenario that SUMO ran: places are in its network's plane."
        )
    slices = slices_in(source)
    name, crs = source.name.split(".")[0], None
    if _is_geographic(slices()):
        first = next(iter(slices()))
        crs = utm_at(float(first.x_m[0]), float(first.y_m[0]))
        recording = Recording(name, lambda: slices_in_plane(slices(), crs), crs, has_scenario_clock=True)
    else:
        recording = Recording(name, slices, has_scenario_clock=True)
    drives, why = virtual_probes([recording], options)
    said = [f"{source.name}: {len(drives)} of its vehicles as subject vehicles.", why]
    if crs:
        said.append("places are longitude and latitude (--fcd-output.geo).")
    return Imported(tuple(drives), tuple(said))


def slices_in(source: Path) -> Callable[[], Iterable[Slice]]:
    """Return what reads floating car data from its begin, slice by slice.

    Raises:
        CaseError: its name ends otherwise than those of such files.
    """
    name = source.name.lower().removesuffix(".gz")
    if name.endswith(".xml"):
        return lambda: _xml_slices(source)
    if name.endswith(".parquet"):
        return lambda: _table_slices(source, _parquet_batches(source))
    if name.endswith(".csv"):
        return lambda: _table_slices(source, _csv_batches(source))
    raise CaseError(source, "", "expected a file that ends in .xml, .csv or .parquet, perhaps with .gz.")


def _xml_slices(source: Path) -> Iterator[Slice]:
    """Slices of XML, which is read piece by piece: such files may be larger than memory."""
    with gzip.open(source) if source.name.lower().endswith(".gz") else source.open("rb") as stream:
        root, vehicles = None, []
        try:
            for event, element in ET.iterparse(stream, ("start", "end")):
                if event == "start":
                    root = element if root is None else root
                elif element.tag == "vehicle":
                    vehicles.append(dict(element.attrib))
                elif element.tag == "timestep":
                    if vehicles:
                        yield _slice(source, float(element.get("time", "nan")), vehicles)
                    vehicles = []
                    if root is not None:
                        root.clear()
        except (ET.ParseError, EOFError, OSError) as error:
            raise CaseError(source, "", f"expected SUMO's XML: {shorten(str(error), 150)}.") from None


def _slice(source: Path, time_s: float, vehicles: list[dict[str, str]]) -> Slice:
    missing = [name for name in ATTRIBUTES if name not in vehicles[0]]
    if missing:
        raise CaseError(
            source,
            f"vehicle {shorten(vehicles[0].get('id', ''))}",
            f"expected the attributes {', '.join(ATTRIBUTES)}; {', '.join(missing)} missing (--fcd-output.attributes).",
        )

    def column(name: str) -> np.ndarray:
        return np.asarray([float(vehicle.get(name) or "nan") for vehicle in vehicles])

    return _slice_of(time_s, np.asarray([one["id"] for one in vehicles]), {n: column(n) for n in _NUMBERS})


_NUMBERS = ("x", "y", "angle", "speed", "acceleration")


def _slice_of(time_s: float, vehicle: np.ndarray, values: Mapping[str, np.ndarray]) -> Slice:
    nothing = np.full(len(vehicle), np.nan)
    return Slice(
        time_s=time_s,
        vehicle=vehicle,
        x_m=values["x"],
        y_m=values["y"],
        heading_rad=np.radians(90.0 - values["angle"]),  # SUMO's angles: clockwise from north
        speed_mps=values["speed"],
        acceleration_mps2=values.get("acceleration", nothing),
        lane=nothing,  # the place tells; SUMO's lane index would count otherwise on a left-hand road
        length_m=nothing,
    )


def _parquet_batches(source: Path) -> Iterator[pa.RecordBatch]:
    try:
        with pyarrow.parquet.ParquetFile(source) as file:
            yield from file.iter_batches(batch_size=1 << 16)
    except pa.ArrowException as error:
        raise CaseError(source, "", f"expected a Parquet table: {shorten(str(error), 150)}.") from None


def _csv_batches(source: Path) -> Iterator[pa.RecordBatch]:
    with gzip.open(source) if source.name.lower().endswith(".gz") else source.open("rb") as stream:
        header = stream.readline(1 << 16).decode("utf-8-sig", "replace")
    separator = next((one for one in SEPARATORS if one in header), ",")
    try:
        with pa.input_stream(source, compression="detect") as stream:
            yield from pyarrow.csv.open_csv(
                stream, parse_options=pyarrow.csv.ParseOptions(delimiter=separator),
                convert_options=pyarrow.csv.ConvertOptions(
                    column_types={f"{prefix}id": pa.string() for prefix in ("vehicle_", "")}, null_values=[""],
                ),
            )  # fmt: skip
    except pa.ArrowException as error:
        raise CaseError(source, "", f"expected SUMO's CSV: {shorten(str(error), 150)}.") from None


def _table_slices(source: Path, batches: Iterable[pa.RecordBatch]) -> Iterator[Slice]:
    """Slices of a table whose rows are in the order of time; an instant may go on in the next batch."""
    held: dict[str, np.ndarray] = {}
    for batch in batches:
        columns = _columns(source, batch)
        if held:
            columns = {name: np.concatenate([held[name], columns[name]]) for name in columns}
        bounds = np.append(np.flatnonzero(np.diff(columns["time"], prepend=np.nan) != 0.0), len(columns["time"]))
        for first, last in itertools.pairwise(bounds[:-1]):  # the last instant may go on
            yield _cut(columns, int(first), int(last))
        held = {name: values[bounds[-2] :] for name, values in columns.items()}
    if held:
        yield _cut(held, 0, len(held["time"]))


def _cut(columns: Mapping[str, np.ndarray], first: int, last: int) -> Slice:
    values = {name: columns[name][first:last] for name in _NUMBERS}
    return _slice_of(float(columns["time"][first]), columns["id"][first:last], values)


def _columns(source: Path, batch: pa.RecordBatch) -> dict[str, np.ndarray]:
    """Columns by SUMO's attribute; rows of instants without vehicles are empty but for the time."""
    names = set(batch.schema.names)

    def values(name: str) -> Any:
        found = next((one for one in (f"vehicle_{name}", f"timestep_{name}", name) if one in names), None)
        if found is not None:
            return batch.column(found)
        if name == "acceleration":
            return None
        raise CaseError(source, f"column {name}", f"expected this column; the file has {', '.join(sorted(names))}.")

    ids = np.asarray(values("id").cast(pa.string()).to_pylist(), object)
    there = np.asarray([bool(vehicle) for vehicle in ids])
    columns: dict[str, np.ndarray] = {"id": ids[there].astype(str)}
    for name in ("time", *_NUMBERS):
        column = values(name)
        numbers = np.full(len(ids), np.nan) if column is None else column.cast(pa.float64()).to_numpy(False)
        columns[name] = np.asarray(numbers)[there]
    return columns


def _is_geographic(slices: Iterable[Slice]) -> bool:
    """Whether places are degrees: they hardly change although the speeds say so."""
    moved_m = driven_m = 0.0
    before: Slice | None = None
    for number, one in enumerate(slices):
        if before is not None:
            _, mine, theirs = np.intersect1d(one.vehicle, before.vehicle, return_indices=True)
            moved_m += float(np.hypot(one.x_m[mine] - before.x_m[theirs], one.y_m[mine] - before.y_m[theirs]).sum())
            driven_m += float(one.speed_mps[mine].sum()) * (one.time_s - before.time_s)
        before = one
        if number > 1000 and driven_m > 1000.0:
            break
    return driven_m > 0.0 and moved_m < STANDING_SHARE * driven_m
