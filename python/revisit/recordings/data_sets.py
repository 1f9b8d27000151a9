"""Readers of MulRan, HeLiPR and NCLT as downloaded: one file per scan, named by its time, and poses with times."""

import numpy as np

from revisit.errors import InputError, UsageError
from revisit.poses import are_rigid, nearest, rigid, table_of
from revisit.recordings.recording import Scan, files_in, is_numbered, read_records, recording_of, records_of

MAX_GAP = 0.1
"""Maximum time difference of a scan and its pose [s]; otherwise the scan has no pose."""


def record(*types, time=None):
    """Returns a packed dtype of x, y, z and more fields. time: index of the field with the point's time."""
    return np.dtype([('time' if i == time else str(i), f'<{name}') for i, name in enumerate(types)])


MULRAN = record(*['f4'] * 4)
HELIPR = {  # as in HeLiPR's file player
    'Ouster': record('f4', 'f4', 'f4', 'f4', 'u4', 'u2', 'u2', 'u2', time=4),
    'Velodyne': record('f4', 'f4', 'f4', 'f4', 'u2', 'f4', time=5),
    'Avia': record('f4', 'f4', 'f4', 'u1', 'u1', 'u1', 'u4', time=6),
    'Aeva': record('f4', 'f4', 'f4', 'f4', 'f4', 'i4', 'u1', 'f4', time=5),
}
AEVA_WITHOUT_INTENSITY, AEVA_CHANGED = record('f4', 'f4', 'f4', 'f4', 'f4', 'i4', 'u1', time=5), 1691936557946849179
NCLT = np.dtype([('xyz', '<u2', 3), ('intensity', 'u1'), ('laser', 'u1')])
Z_UP_OF_NCLT = np.diag([1.0, -1, -1, 1])
"""Conversion of NCLT's body and world, which have z down."""


def euler(angles):
    """Returns Rz(yaw) Ry(pitch) Rx(roll), [n][3][3], of roll, pitch and yaw [n][3] in rad."""
    def about(axis, angle):
        half = np.zeros((len(angle), 4))
        half[:, axis], half[:, 3] = np.sin(angle / 2), np.cos(angle / 2)
        return rigid(np.zeros((len(angle), 3)), half)[:, :3, :3]
    roll, pitch, yaw = np.asarray(angles, np.float64).T
    return about(2, yaw) @ about(1, pitch) @ about(0, roll)


MULRAN_EXTRINSIC = np.eye(4)
"""T_base_ouster, from the data set's calib_base2ouster.txt."""
MULRAN_EXTRINSIC[:3, :3] = euler(np.radians([[0.0001, 0.0003, 179.6654]]))[0]
MULRAN_EXTRINSIC[:3, 3] = 1.7042, -0.021, 1.8047


def timed(name, files, unit, read, truth, poses_of):
    """Returns a recording of files named by times in `unit` seconds.

    truth: file and table of the poses, whose first column is the time in the same unit; or None.
    poses_of: converts the other columns to T_world_lidar [n][4][4].
    """
    times = [int(file.stem) * unit for file in files]
    poses, warnings = [None] * len(files), []
    if truth is not None:
        file, table = truth
        table = table[np.argsort(table[:, 0], kind='stable')]
        all_poses = poses_of(table[:, 1:])
        index, gaps = nearest(table[:, 0] * unit, np.asarray(times))
        odd = (gaps <= MAX_GAP) & ~are_rigid(all_poses)[index]
        if odd.any():
            raise InputError(f'{file}: expected rigid transforms (rotation, translation), found another matrix at time '
                             f'{table[index[np.argmax(odd)], 0]:.0f}')
        poses = [all_poses[i] if gap <= MAX_GAP else None for i, gap in zip(index, gaps)]
        if lost := sum(pose is None for pose in poses):
            warnings.append(f'{lost} of {len(files)} scans have no pose within {MAX_GAP} s')
    return recording_of(name, [Scan(i, time, pose, lambda file=file: read(file), str(file))
                               for i, (file, time, pose) in enumerate(zip(files, times, poses))], warnings)


def first_table(files, delimiter, columns, holes=False):
    """Returns the first existing file with its table, or None."""
    for file in files:
        if file.is_file():
            table = table_of(file, delimiter, holes)
            if table.shape[1] < columns:
                raise InputError(f'{file}: expected {columns} columns, found {table.shape[1]}')
            return file, table
    return None


def holds_scans(folder):
    return any(is_numbered(file) for file in folder.glob('*.bin'))


# MulRan: Ouster/TIME.bin [ns]; global_pose.csv: time, rows of the base's 3 x 4 pose in a world with z up.

def mulran_folder(path):
    return next((folder for folder in (path / 'Ouster', path / 'sensor_data' / 'Ouster') if holds_scans(folder)), None)


def detects_mulran(path):
    return mulran_folder(path) is not None


def open_mulran(path):
    def poses_of(rows):
        poses = np.tile(np.eye(4), (len(rows), 1, 1))
        poses[:, :3] = rows[:, :12].reshape(-1, 3, 4)
        return poses @ MULRAN_EXTRINSIC

    return timed(path.name, files_in(mulran_folder(path), '.bin'), 1e-9, lambda file: read_records(file, MULRAN),
                 first_table([path / 'global_pose.csv'], ',', 13), poses_of)


# HeLiPR: LiDAR/SENSOR/TIME.bin [ns]; LiDAR_GT/global_SENSOR_gt.txt: time [ns] and the lidar's pose in TUM's format.

def helipr_sensors(path):
    return [name for name in HELIPR if holds_scans(path / 'LiDAR' / name)]


def detects_helipr(path):
    return bool(helipr_sensors(path))


def open_helipr(path, sequence):
    there = helipr_sensors(path)
    if sequence not in there and (sequence or len(there) > 1):
        raise UsageError(f'{path}: choose the lidar with --sequence: {", ".join(there)}')
    sensor = sequence or there[0]

    def read(file):
        old = sensor == 'Aeva' and int(file.stem) <= AEVA_CHANGED
        return read_records(file, AEVA_WITHOUT_INTENSITY if old else HELIPR[sensor])

    truth = path / 'LiDAR_GT'
    return timed(f'{path.name}-{sensor}', files_in(path / 'LiDAR' / sensor, '.bin'), 1e-9, read,
                 first_table([truth / f'global_{sensor}_gt.txt', truth / f'{sensor}_gt.txt'], None, 8),
                 lambda rows: rigid(rows[:, :3], rows[:, 3:7]))


# NCLT: velodyne_sync/TIME.bin [us]; groundtruth_DATE.csv: time, x, y, z, roll, pitch, yaw.

def detects_nclt(path):
    return holds_scans(path / 'velodyne_sync')


def read_nclt(file):
    """Integers are multiples of 5 mm, offset by -100 m. The file has y right and z down."""
    points = records_of(file, NCLT)['xyz'] * np.float32(0.005) - np.float32(100)
    return points * np.float32([1, -1, -1]), None


def open_nclt(path):
    truth = f'groundtruth_{path.resolve().name}.csv'

    def poses_of(rows):
        poses = np.tile(np.eye(4), (len(rows), 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = euler(rows[:, 3:6]), rows[:, :3]
        return Z_UP_OF_NCLT @ poses @ Z_UP_OF_NCLT

    return timed(path.resolve().name, files_in(path / 'velodyne_sync', '.bin'), 1e-6, read_nclt,
                 first_table([path / truth, path.parent / 'ground_truth' / truth], ',', 7, holes=True), poses_of)
