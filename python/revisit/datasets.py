"""Sequences and folders of scans: KITTI's layout, .bin, .pcd and .ply files."""

from revisit._core.datasets import (
    Dataset, ScanRef, deskew, open_dataset, perturb, point_times, read_scan, read_timed_scan, time_in_name, write_kitti_scan)

__all__ = [
    'Dataset', 'ScanRef', 'deskew', 'open_dataset', 'perturb', 'point_times', 'read_scan', 'read_timed_scan', 'time_in_name',
    'write_kitti_scan']
