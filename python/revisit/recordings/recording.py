"""Interface of readers: scans with frame, time and pose, whose points are read on demand."""

import importlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from revisit.datasets import point_times
from revisit.errors import Error, InputError


POINT_TIMES = ('t', 'time', 'timestamp', 'offset_time', 'point_time_offset')
"""Names of fields with times of points, in the order of preference."""


class Scan(NamedTuple):
    frame: int
    """Counted from 0, or the number in the file's name."""
    time: float | None
    """[s]"""
    pose: np.ndarray | None
    """T_world_lidar, float64 [4][4], in KITTI's world; see revisit.poses."""
    read: Callable[[], tuple[np.ndarray, np.ndarray | None]]
    """Reads points, float32 [n][3 or more] in the lidar's frame [m], possibly a view, and their times relative to the scan's
    stamp, float32 [n] [s]; None without times. Raises InputError if the data is not a scan."""
    source: str
    """For messages: the file, or the bag and the frame."""

    def points(self) -> np.ndarray:
        return self.read()[0]


class Recording(NamedTuple):
    name: str
    """Name of the drive."""
    count: int | None
    """Number of scans, or None if unknown before reading."""
    scans: Callable[[], Iterator[Scan]]
    """Iterates from the first scan at every call. Raises InputError if the recording ends within a scan."""
    warnings: list[str] = []


class Reader(NamedTuple):
    name: str
    detects: Callable[[Path], bool]
    opens: Callable[..., Recording]
    takes_sequence: bool = False
    """Whether `opens` takes a sequence after the path."""


def package(name, install, what):
    """Imports an optional package. Raises Error with the package to install."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise Error(f'{what} needs the package {install}: pip install {install} ({error})') from None


def time_names(names) -> list[str]:
    """Returns the names in POINT_TIMES. With a field s, t is a texture coordinate."""
    return [name for name in POINT_TIMES if name in names and not (name == 't' and 's' in names)]


def times_of(values, stamp=None):
    """Converts a recording's times of points, integer or floating-point, by revisit.datasets.point_times()."""
    return point_times(values.astype(np.float64).ravel(), values.dtype.kind != 'f', stamp)


def recording_of(name, scans, warnings=()) -> Recording:
    return Recording(name, len(scans), lambda: iter(scans), list(warnings))


def is_numbered(file) -> bool:
    return file.stem.isdecimal()


def files_in(folder, ending) -> list[Path]:
    """Returns the files NUMBER`ending`, sorted by number. Raises InputError if there are none."""
    files = [file for file in folder.glob(f'*{ending}') if is_numbered(file)]
    if not files:
        raise InputError(f'{folder}: expected files NUMBER{ending}, found none')
    return sorted(files, key=lambda file: int(file.stem))


def bytes_of(file) -> np.ndarray:
    """Reads uint8 [n]. Raises InputError for devices and pipes, too, which may be endless."""
    try:
        if not file.is_file():
            raise InputError(f'{file}: {"not a regular file" if file.exists() else "no such file"}')
        return np.fromfile(file, np.uint8)
    except (OSError, ValueError) as error:  # ValueError: an invalid file name
        raise InputError(f'{file}: {getattr(error, "strerror", None) or error}') from None


def records_of(file, record) -> np.ndarray:
    """Reads an array [n] of the dtype `record`, one element per point."""
    data = bytes_of(file)
    if data.size == 0 or data.size % record.itemsize:
        raise InputError(f'{file}: expected points of {record.itemsize} bytes each, found {data.size} bytes')
    return data.view(record)


def read_records(file, record):
    """Reads points of records that begin with x, y, z as float32: a view, float32 [n][3]. Times are the field `time`, if any."""
    records = records_of(file, record)
    points = np.ndarray((len(records), 3), '<f4', records, strides=(record.itemsize, 4))
    return points, times_of(records['time']) if 'time' in record.names else None
