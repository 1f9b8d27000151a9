"""Reader of KITTI-360: data_3d_raw/DRIVE/velodyne_points, poses of the IMU for some frames, calibration."""

from datetime import datetime, timezone

import numpy as np

from revisit.datasets import read_scan
from revisit.errors import InputError, UsageError
from revisit.poses import matrix_of, table_of
from revisit.recordings.recording import Scan, files_in, recording_of


def detects(path):
    return (path / 'data_3d_raw').is_dir() or (path / 'velodyne_points' / 'data').is_dir()


def drive_of(path, sequence):
    """Returns the root of the data set and the folder of the drive: the only one, or that of `sequence` (0000 ... 0018)."""
    if not (path / 'data_3d_raw').is_dir():
        return path.resolve().parent.parent, path
    there = sorted(folder for folder in (path / 'data_3d_raw').iterdir() if (folder / 'velodyne_points' / 'data').is_dir())
    asked = [folder for folder in there if not sequence or sequence == folder.name or f'_{sequence.zfill(4)}_' in folder.name]
    if len(asked) == 1:
        return path, asked[0]
    names = ', '.join(folder.name for folder in there)
    if not there:
        raise InputError(f'{path}: expected data_3d_raw/DRIVE/velodyne_points/data, found no drive')
    raise UsageError(f'{path}: choose the drive with --sequence: {names}')


def times_of(file):
    """Parses lines of "2013-05-28 08:46:02.904626944" to seconds since 1970. None without the file."""
    if not file.is_file():
        return None
    times = []
    for number, line in enumerate(file.read_text(errors='replace').split('\n'), 1):
        if not line.strip():
            continue
        try:
            day, _, fraction = line.strip().partition('.')
            moment = datetime.strptime(day, '%Y-%m-%d %H:%M:%S').replace(tzinfo=timezone.utc)
            times.append(moment.timestamp() + float(f'0.{fraction or 0}'))
        except ValueError:
            raise InputError(f'{file}:{number}: expected a date and a time, found {line[:60]!r}') from None
    return times


def calibration(folder):
    """Returns T_imu_velo from the left camera's poses in the IMU's and the Velodyne's frame."""
    to_pose, to_velo = folder / 'calib_cam_to_pose.txt', folder / 'calib_cam_to_velo.txt'
    try:
        left = next(line.split()[1:] for line in to_pose.read_text().splitlines() if line.startswith('image_00:'))
        T_imu_cam = matrix_of([float(number) for number in left], to_pose)
    except (OSError, StopIteration, ValueError):
        raise InputError(f'{to_pose}: expected a line "image_00:" with 12 numbers, which poses.txt needs') from None
    return T_imu_cam @ np.linalg.inv(matrix_of(table_of(to_velo).ravel(), to_velo))


def poses_of(root, drive):
    """Returns frame -> T_world_lidar."""
    file = root / 'data_poses' / drive.name / 'poses.txt'
    if not file.is_file():
        return {}
    table = table_of(file)
    if table.shape[1] != 13:
        raise InputError(f'{file}: expected a frame and 12 numbers per line, found {table.shape[1]} columns')
    T_imu_velo = calibration(root / 'calibration')
    return {int(row[0]): matrix_of(row[1:], file) @ T_imu_velo for row in table}


def open_kitti_360(path, sequence):
    root, drive = drive_of(path, sequence)
    poses, times = poses_of(root, drive), times_of(drive / 'velodyne_points' / 'timestamps.txt')
    scans = []
    for file in files_in(drive / 'velodyne_points' / 'data', '.bin'):
        frame = int(file.stem)
        if times is not None and frame >= len(times):
            raise InputError(f'{drive}: expected a time for frame {frame} ({file.name}), found {len(times)} times in timestamps.txt')
        scans.append(Scan(frame, times and times[frame], poses.get(frame), lambda file=file: (read_scan(file), None), str(file)))
    lost = sum(scan.pose is None for scan in scans)
    warnings = [f'{lost} of {len(scans)} scans have no pose'] if poses and lost else []
    return recording_of(drive.name, scans, warnings)
