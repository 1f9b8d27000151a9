"""Readers of KITTI's odometry layout and of folders of .bin, .pcd, .ply (by the C++ library) and .npy files."""

import numpy as np

from revisit.datasets import open_dataset, read_recorded_scan, time_in_name
from revisit.errors import InputError
from revisit.poses import AXES_OF_CAMERA, read_extrinsic
from revisit.recordings.recording import RecordedTimes, Scan, recording_of, time_of_points


def detects(path):
    return path.is_dir()


def detects_npy(path):
    endings = {file.suffix.lower() for file in path.iterdir()} if path.is_dir() else set()
    return '.npy' in endings and not endings & {'.bin', '.pcd', '.ply'}


def read_file(file):
    points, field, values = read_recorded_scan(file)
    return points, RecordedTimes(field, values) if field else None


def open_scans(path, sequence):
    dataset = open_dataset(path, sequence)
    scans = dataset.scans
    calibration = scans[0].file.parent.parent / 'calib.txt'
    extrinsic = read_extrinsic(calibration) if dataset.has_poses and calibration.is_file() else AXES_OF_CAMERA
    return recording_of(dataset.sequence or dataset.name, [
        Scan(scan.frame, scan.time, None if scan.pose is None else scan.pose @ extrinsic,
             lambda file=scan.file: read_file(file), str(scan.file)) for scan in scans], dataset.warnings)


def read_npy(file):
    """Reads points and times of floating-point [n][3 or more], or of a structured array with fields x, y, z and optional times."""
    if not file.is_file():
        raise InputError(f'{file}: not a regular file')
    try:
        points = np.load(file, mmap_mode='r', allow_pickle=False)
    except Exception as error:  # numpy parses the header as Python, which raises many types
        raise InputError(f'{file}: cannot be read as an array: {error}') from None
    if not isinstance(points, np.ndarray):
        points.close()
        raise InputError(f'{file}: expected one array, found an archive')
    times = None
    if points.dtype.names and points.ndim == 1:
        times = time_of_points(points.dtype.names,
                               lambda name: points[name] if points[name].ndim == 1 and points[name].dtype.kind in 'iuf' else None)
    if points.dtype.names and {'x', 'y', 'z'} <= set(points.dtype.names) and points.ndim == 1:
        points = np.stack([points[axis] for axis in 'xyz'], -1)
    turned = points.ndim == 2 and len(points) in (3, 4) and points.shape[1] > 16  # as in arrays that programs give
    if points.ndim != 2 or points.shape[1] < 3 or points.dtype.kind != 'f' or turned:
        raise InputError(f'{file}: expected a floating-point array [n][3 or more], found {points.dtype} of shape {points.shape}'
                         + ', which has a column for each point' * turned)
    return points[:, :3].astype(np.float32, copy=False), times


def open_npy(path):
    files = sorted(path.glob('*.npy'), key=lambda file: (len(file.stem), file.stem))
    times = [time_in_name(file) for file in files]
    if None in times:
        times = [None] * len(files)
    else:
        times, files = zip(*sorted(zip(times, files)))
    return recording_of(path.name, [Scan(frame, time, None, lambda file=file: read_npy(file), str(file))
                                    for frame, (file, time) in enumerate(zip(files, times))])
