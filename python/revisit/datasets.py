"""Sequences and folders of scans: KITTI's layout, .bin, .pcd and .ply files."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from revisit._core.datasets import (
    POINT_TIME_NAMES, Dataset, PointTimes, ScanRef, deskew, open_dataset, perturb, read_recorded_scan, read_scan, time_in_name,
    write_kitti_scan)

__all__ = [
    'POINT_TIME_NAMES', 'Dataset', 'PointTimes', 'ScanRef', 'deskew', 'open_dataset', 'perturb', 'point_times',
    'read_recorded_scan', 'read_scan', 'time_in_name', 'write_kitti_scan']


def point_times(values: ArrayLike, stamp: float | None = None, *, period: float | None = None,
                unit: str = 'auto') -> NDArray[np.float32] | None:
    """Converts the times of a scan's points, numbers [n], to seconds from the scan's stamp: float32 [n].

    stamp [s]: for times of a clock; None: they count from the earliest point. period [s]: of the scans, which decides the unit
    with the span of the values. unit: auto, s, ms, us, ns, or scan: 0 to 1 of a period. Invalid values become NaN. Returns None
    if the values cannot be times of one scan. PointTimes decides once for all scans of a recording.
    """
    given = np.ascontiguousarray(values, np.float64).ravel()
    return PointTimes([('', given, stamp)], unit, period).of(given, stamp)
