"""The tables of a drive that an automated vehicle recorded: its own motion, and objects in its own frame."""

from collections.abc import Iterable

import numpy as np
import pandas as pd
import pyproj

from jaxcalib.field.log_tables import OBJECT_COLUMNS, SUBJECT_COLUMNS
from jaxcalib.importers.data_frame import Frame
from jaxcalib.importers.importer import USUAL_BEGIN_S, ImportedDrive, ImportOptions
from jaxcalib.importers.planes import from_vehicle_frame
from jaxcalib.importers.trajectories import path_heading_rad
from sim_adapters.units import kmh_from_mps

SMOOTHED_S = 1.0  # of places, before a heading is taken from them


def recorded_drive(name: str, own: Frame, objects: Frame, crs: str | None, options: ImportOptions) -> ImportedDrive:
    """Lay what a vehicle saw into the plane that it drove in.

    Args:
        name: of the drive.
        own: columns time_s, x_m, y_m, speed_mps, and, where they are known, acceleration_mps2, yaw_rate_radps and
            heading_rad (counterclockwise from +x; taken from the places otherwise).
        objects: columns time_s, vehicle_id, ahead_m, left_m, speed_mps, and length_m where it is known; front bumper
            to front bumper.
        crs: coordinate reference system of the plane; None for the network's.
        options: what the user chose.
    """
    own = own.sort_values("time_s", kind="stable").drop_duplicates("time_s").reset_index(drop=True)
    time_s = own["time_s"].to_numpy(float)
    if "heading_rad" not in own:
        num_rows = max(1, round(SMOOTHED_S / max(float(np.median(np.diff(time_s))), 1e-3)))
        smooth = own[["x_m", "y_m"]].rolling(num_rows, 1, center=True).mean().to_numpy()
        own["heading_rad"] = path_heading_rad(smooth[:, 0], smooth[:, 1])
    heading_rad = own["heading_rad"].interpolate(limit_direction="both").to_numpy(float)
    pose = (time_s, own["x_m"].to_numpy(float), own["y_m"].to_numpy(float), heading_rad)
    seen_s = objects["time_s"].to_numpy(float)
    x_m, y_m = from_vehicle_frame(pose, seen_s, objects["ahead_m"].to_numpy(float), objects["left_m"].to_numpy(float))
    first_s = time_s[0]
    later_s = (USUAL_BEGIN_S if options.begin_s is None else options.begin_s) - first_s
    subject = pd.DataFrame(
        {
            "time_s": np.round(time_s + later_s, 6),
            "speed_kmh": kmh_from_mps(own["speed_mps"].to_numpy(float)),
            "yaw_rate_radps": own.get("yaw_rate_radps", np.nan),
            "acceleration_mps2": own.get("acceleration_mps2", np.nan),
            "x_m": pose[1],
            "y_m": pose[2],
        }
    )
    seen = pd.DataFrame(
        {
            "time_s": np.round(seen_s + later_s, 6),
            "vehicle_id": objects["vehicle_id"].astype(str).to_numpy(),
            "speed_kmh": kmh_from_mps(objects["speed_mps"].to_numpy(float)),
            "length_m": objects["length_m"].to_numpy(float) if "length_m" in objects else np.nan,
            "x_m": x_m,
            "y_m": y_m,
        }
    )
    return ImportedDrive(name, with_places(subject, crs, SUBJECT_COLUMNS), with_places(seen, crs, OBJECT_COLUMNS))


def with_places(table: Frame, crs: str | None, columns: Iterable[str]) -> Frame:
    """A table with all columns of Table 1; places on the globe where their plane is not the network's.

    Args:
        table: columns x_m and y_m, and others.
        crs: coordinate reference system of these; None for the network's plane.
        columns: those that come first, empty where the table lacks them.
    """
    if crs is not None:
        to_globe = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
        longitude_deg, latitude_deg = to_globe.transform(table["x_m"].to_numpy(), table["y_m"].to_numpy())
        table = table.drop(columns=["x_m", "y_m"])
        table = table.assign(longitude_rad=np.radians(longitude_deg), latitude_rad=np.radians(latitude_deg))
    table = table.reindex(columns=[*columns, *(name for name in table if name not in columns)])
    return table.assign(road="") if "road" in table else table  # nobody knows it; a text all the same
