"""Interface of readers: scans with frame, time and pose, whose points are read on demand."""

import contextlib
import importlib
import itertools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from revisit.datasets import POINT_TIME_NAMES, PointTimes
from revisit.errors import Error, InputError

SHOWN, READ = 20, 4
"""First scans whose stamps, and whose points, show the convention of times of points."""


class RecordedTimes(NamedTuple):
    """Times of points as recorded, with the name of their field."""
    field: str
    values: NDArray[Any]
    """[n], integers or floating-point numbers."""


class Scan(NamedTuple):
    """A scan whose points are read on demand."""
    frame: int
    """Counted from 0, or the number in the file's name."""
    time: float | None
    """[s]"""
    pose: NDArray[np.float64] | None
    """T_world_lidar, float64 [4][4]. The world has z up, or the axes of KITTI's camera in KITTI's layout."""
    read: Callable[[], tuple[NDArray[Any], Any]]
    """Reads points, float32 [n][3 or more] in the lidar's frame [m], possibly a view, and their times, or None. Of
    open_recording(): float32 [n] [s], relative to the scan's stamp; of a reader: RecordedTimes. Raises InputError if the data
    is not a scan."""
    source: str
    """For messages: the file, or the bag and the frame."""

    def points(self) -> NDArray[Any]:
        """Reads the points, float32 [n][3 or more] [m]. Raises InputError if the data is not a scan."""
        return self.read()[0]


class Recording(NamedTuple):
    """A drive. scans() starts at the first scan at every call."""
    name: str
    """Name of the drive."""
    count: int | None
    """Number of scans, or None if unknown before reading."""
    scans: Callable[[], Iterator[Scan]]
    """Iterates from the first scan at every call. Raises InputError if the recording ends within a scan."""
    warnings: list[str] = []
    point_times: str = ''
    """Convention of the times of points that was found, or the reason why there are none."""


class Reader(NamedTuple):
    """A format of recordings. detects(path): this is one. opens(path) raises InputError for malformed data."""
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


def time_of_points(names, values_of) -> RecordedTimes | None:
    """Returns the first of POINT_TIME_NAMES that has values. With a field s, t is a texture coordinate.

    values_of(name): the field's values; None if it cannot be a time.
    """
    for name in POINT_TIME_NAMES:
        if name not in names or (name == 't' and 's' in names):
            continue
        values = values_of(name)
        if name == 'timestampSec':
            nano = values_of('timestampNsec') if 'timestampNsec' in names else None
            values = None if values is None or nano is None else values.astype(np.int64) * 10**9 + nano.astype(np.int64)
        if values is not None:
            return RecordedTimes(name, values.ravel())
    return None


def samples_of(recording):
    """Yields field, times and stamp of the first scans: what shows the convention of times of points."""
    read = timed = 0
    with contextlib.suppress(InputError):  # raised again by the pass
        for scan in itertools.islice(recording.scans(), SHOWN):
            times = None
            if read < READ:
                with contextlib.suppress(InputError):
                    times = scan.read()[1]
                    read += 1
                    timed += times is not None
            elif not timed:
                return
            yield ('', None, scan.time) if times is None else (times.field, times.values.astype(np.float64), scan.time)


def with_point_times(recording, unit='auto') -> Recording:
    """Converts the times of points to seconds from the stamps, by one convention for the recording; drops points with invalid times.

    unit: auto, s, ms, us, ns, scan (0 to 1) or none.
    """
    convention = PointTimes([] if unit == 'none' else list(samples_of(recording)), unit)

    def converted(scan):
        points, recorded = scan.read()
        times = recorded and convention.of(recorded.values.astype(np.float64), scan.time)
        if times is None:
            return points, None
        valid = np.isfinite(times)
        return (points, times) if valid.all() else (points[valid], times[valid])

    def scans():
        for scan in recording.scans():
            yield scan._replace(read=lambda scan=scan: converted(scan))

    return recording._replace(scans=scans, point_times=convention.text)


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
    return points, RecordedTimes('time', records['time']) if 'time' in record.names else None
