"""Sequences and folders of scans: KITTI's layout, .bin, .pcd and .ply files."""

import numpy as np

from revisit._core.datasets import (
    POINT_TIME_NAMES, Dataset, PointTimes, ScanRef, deskew, open_dataset, perturb, read_recorded_scan, read_scan, time_in_name,
    write_kitti_scan)

__all__ = [
    'POINT_TIME_NAMES', 'Dataset', 'PointTimes', 'ScanRef', 'deskew', 'open_dataset', 'perturb', 'point_times',
    'read_recorded_scan', 'read_scan', 'time_in_name', 'write_kitti_scan']


def point_times(values, stamp=None, *, period=None, unit='auto'):
    """Converts the times of a scan's points, numbers [n], to seconds from the scan's stamp: float32 [n].

    stamp [s]: for times of a clock; None: they count from the earliest point. period [s]: of the scans, which decides the unit
    with the span of the values. unit: auto, s, ms, us, ns, or scan: 0 to 1 of a period. Invalid values become NaN. Returns None
    if the values cannot be times of one scan. PointTimes decides once for all scans of a recording.
    """
    values = np.ascontiguousarray(values, np.float64).ravel()
    return PointTimes([('', values, stamp)], unit, period).of(values, stamp)
