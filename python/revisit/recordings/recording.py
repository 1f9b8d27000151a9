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
    points: Callable[[], np.ndarray]
    """Reads float32 [n][3 or more] in the lidar's frame [m], possibly a view. Raises InputError if the data is not a scan."""
    source: str
    """For messages: the file, or the bag and the frame."""
    read: Callable[[], tuple[np.ndarray, np.ndarray | None]] | None = None
    """Reads the result of timed(), in recordings that may have times of points."""

    def timed(self) -> tuple[np.ndarray, np.ndarray | None]:
        """Reads the points and their times relative to the scan's stamp, float32 [n] [s]; None without times."""
        return self.read() if self.read else (self.points(), None)


class Recording(NamedTuple):
    name: str
    """Name of the drive."""
    count: int | None
    """Number of scans, or None if unknown before reading."""
    scans: Callable[[], Iterator[Scan]]
    """Iterates from the first scan at every call. Raises InputError if the recording ends within a scan."""
    times: Callable[[], tuple[list[int], list[float | None]]]
    """Returns frames and times of all scans; may read the full recording."""
    warnings: list[str] = []


class Reader(NamedTuple):
    name: str
    detects: Callable[[Path], bool]
    opens: Callable[[Path, 'Options'], Recording]
    takes: tuple[str, ...] = ()
    """Names of the supported options."""


class Options(NamedTuple):
    topic: str | None = None
    sequence: str = ''
    meta: str | None = None


def package(name, install, what):
    """Imports an optional package. Raises Error with the package to install."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise Error(f'{what} needs the package {install}: pip install {install} ({error})') from None


def timed_scan(frame, time, pose, read, source) -> Scan:
    return Scan(frame, time, pose, lambda: read()[0], source, read)


def time_names(names) -> list[str]:
    """Returns the names in POINT_TIMES. With a field s, t is a texture coordinate."""
    return [name for name in POINT_TIMES if name in names and not (name == 't' and 's' in names)]


def times_of(values, stamp=None):
    """Converts a recording's times of points, integer or floating-point, by revisit.datasets.point_times()."""
    return point_times(values.astype(np.float64).ravel(), values.dtype.kind != 'f', stamp)


def recording_of(name, scans, warnings=()) -> Recording:
    return Recording(name, len(scans), lambda: iter(scans),
                     lambda: ([scan.frame for scan in scans], [scan.time for scan in scans]), list(warnings))


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


def read_records(file, record) -> np.ndarray:
    """Reads points of records that begin with x, y, z as float32; returns a view, float32 [n][3]."""
    return read_timed_records(file, record)[0]


def read_timed_records(file, record):
    """Reads points as read_records(), and times of points from the field `time`; None without this field."""
    data = bytes_of(file)
    if data.size == 0 or data.size % record.itemsize:
        raise InputError(f'{file}: expected points of {record.itemsize} bytes each, found {data.size} bytes')
    points = np.ndarray((data.size // record.itemsize, 3), '<f4', data, strides=(record.itemsize, 4))
    return points, times_of(data.view(record)['time']) if 'time' in record.names else None
