"""What a reader gives: scans, each with its frame, time and pose, whose points are read when they are asked for."""

import importlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from revisit.datasets import point_times
from revisit.errors import Error, InputError


POINT_TIMES = ('t', 'time', 'timestamp', 'offset_time', 'point_time_offset')
"""Names of the fields that hold the times of points, the first of them that is there."""


class Scan(NamedTuple):
    frame: int
    """Counted from 0, or the number that is the file's name."""
    time: float | None
    """[s]"""
    pose: np.ndarray | None
    """T_world_lidar, float64 [4][4], in KITTI's world: revisit.poses."""
    points: Callable[[], np.ndarray]
    """float32 [n][3 or more] in the lidar's frame [m], perhaps a view of what was read. InputError when they are not a scan."""
    source: str
    """For people: the file, or the bag and the frame."""
    read: Callable[[], tuple[np.ndarray, np.ndarray | None]] | None = None
    """Where the recording may have the times of points: what timed() gives."""

    def timed(self) -> tuple[np.ndarray, np.ndarray | None]:
        """The points, and their times from the scan's stamp on, float32 [n] [s]; None where the recording has none."""
        return self.read() if self.read else (self.points(), None)


class Recording(NamedTuple):
    name: str
    """Of the drive."""
    count: int | None
    """Of the scans, when it is known before they are read."""
    scans: Callable[[], Iterator[Scan]]
    """From the first one again at every call. InputError when the recording ends in the middle of one."""
    times: Callable[[], tuple[list[int], list[float | None]]]
    """Frames and times of all scans; may read the recording once."""
    warnings: list[str] = []


class Reader(NamedTuple):
    name: str
    detects: Callable[[Path], bool]
    opens: Callable[[Path, 'Options'], Recording]
    takes: tuple[str, ...] = ()
    """Which of the options mean something to it."""


class Options(NamedTuple):
    topic: str | None = None
    sequence: str = ''
    meta: str | None = None


def package(name, install, what):
    """A package that may be missing. Raises Error saying what to install."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise Error(f'{what} needs the package {install}: pip install {install} ({error})') from None


def timed_scan(frame, time, pose, read, source) -> Scan:
    """read(): the points and their times."""
    return Scan(frame, time, pose, lambda: read()[0], source, read)


def time_names(names) -> list[str]:
    """Those of POINT_TIMES. A t beside an s is a coordinate in a texture."""
    return [name for name in POINT_TIMES if name in names and not (name == 't' and 's' in names)]


def times_of(values, stamp=None):
    """The times of points as a recording has them, an integer or floating-point array: revisit.datasets.point_times()."""
    return point_times(values.astype(np.float64).ravel(), values.dtype.kind != 'f', stamp)


def recording_of(name, scans, warnings=()) -> Recording:
    """Of scans that are all known beforehand."""
    return Recording(name, len(scans), lambda: iter(scans),
                     lambda: ([scan.frame for scan in scans], [scan.time for scan in scans]), list(warnings))


def is_numbered(file) -> bool:
    return file.stem.isdecimal()


def files_in(folder, ending) -> list[Path]:
    """By the number that is the name. InputError without any."""
    files = [file for file in folder.glob(f'*{ending}') if is_numbered(file)]
    if not files:
        raise InputError(f'{folder}: no files NUMBER{ending} here')
    return sorted(files, key=lambda file: int(file.stem))


def bytes_of(file) -> np.ndarray:
    """uint8 [n]. InputError also for what never ends, a device or a pipe."""
    try:
        if not file.is_file():
            raise InputError(f'{file}: {"is no file" if file.exists() else "there is no such file"}')
        return np.fromfile(file, np.uint8)
    except (OSError, ValueError) as error:  # a name that no file can have
        raise InputError(f'{file}: {getattr(error, "strerror", None) or error}') from None


def read_records(file, record) -> np.ndarray:
    """float32 [n][3], a view of a file of records whose first three fields are x, y, z as float32."""
    return read_timed_records(file, record)[0]


def read_timed_records(file, record):
    """The same, and the times of points, of the field `time`; None without such a field."""
    data = bytes_of(file)
    if data.size == 0 or data.size % record.itemsize:
        raise InputError(f'{file}: expected points of {record.itemsize} bytes each, found {data.size} bytes')
    points = np.ndarray((data.size // record.itemsize, 3), '<f4', data, strides=(record.itemsize, 4))
    return points, times_of(data.view(record)['time']) if 'time' in record.names else None
