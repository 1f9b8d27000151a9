"""Trajectories in KITTI's, TUM's and EuRoC's form, and whose axes they have.

Poses are float64 [n][4][4], T_world_sensor, in metres. The world of all that this package keeps has the axes of KITTI's
camera (x to the right, y down, z forward), so that a horizontal distance is one of x and z, whatever a file has.
"""

import warnings
from typing import NamedTuple

import numpy as np

from revisit._core import datasets as native
from revisit._core.datasets import read_extrinsic
from revisit.errors import InputError, UsageError

__all__ = ['AXES_OF_CAMERA', 'FORMATS', 'FRAMES', 'Trajectory', 'in_frame', 'in_kitti_world', 'matched', 'quaternion',
           'read_extrinsic', 'read_trajectory', 'rigid', 'tum_line']

FORMATS = ('kitti', 'tum', 'euroc')
FRAMES = ('lidar', 'camera')
AXES_OF_CAMERA = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]], np.float64)
"""T_camera_lidar of a camera that looks ahead: lidars have x forward, y to the left, z up."""


class Trajectory(NamedTuple):
    file: str
    times: np.ndarray | None
    """[n], seconds; None in KITTI's form: pose i is that of frame i."""
    poses: np.ndarray
    """[n][4][4], as the file has them."""


def rigid(translations, quaternions):
    """[n][4][4] of translations [n][3] and quaternions [n][4] as x, y, z, w of any length; NaN where it is 0."""
    with np.errstate(invalid='ignore'):
        x, y, z, w = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    poses = np.zeros((len(x), 4, 4))
    poses[:, 0, :3] = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], 1)
    poses[:, 1, :3] = np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], 1)
    poses[:, 2, :3] = np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], 1)
    poses[:, :3, 3] = translations
    poses[:, 3, 3] = 1
    return poses


def are_rigid(poses):
    """[n]: each is a rotation and a translation, as far as a file with few digits says it."""
    R = poses[:, :3, :3]
    with np.errstate(all='ignore'):  # numbers that are not finite are no rotation
        off = abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max((1, 2))
        return (off < 1e-3) & (np.linalg.det(R) > 0) & np.isfinite(poses).all((1, 2))


def table_of(file, delimiter=None, holes=False):
    """The numbers of a text file, float64 [rows][columns]; lines that begin with # are skipped.

    holes: rows with NaN are left out, too, not refused.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', UserWarning)  # of an empty file, which is refused below
            table = np.loadtxt(file, delimiter=delimiter, comments='#', ndmin=2)
    except (OSError, ValueError) as error:
        raise InputError(f'{file}: cannot be read as a table of numbers: {error}') from None
    if holes:
        table = table[~np.isnan(table).any(1)]
    if not table.size:
        raise InputError(f'{file}: is empty')
    if not np.isfinite(table).all():
        raise InputError(f'{file}: row {int(np.argmin(np.isfinite(table).all(1))) + 1} of the numbers holds some that are '
                         'not finite')
    return table


def read_trajectory(file, form=None) -> Trajectory:
    """A file of poses; its form is guessed from what is in it when it is None. InputError naming the file."""
    if form is not None and form not in FORMATS:
        raise UsageError(f'poses: expected one of {", ".join(FORMATS)}, found {form!r}')
    times, poses = native.read_trajectory(file, form and native.PoseFormat[form])
    return Trajectory(str(file), np.array(times) if times else None, poses)


def matrix_of(numbers, file) -> np.ndarray:
    """T [4][4] of the 12 numbers of a 3 x 4 matrix in `file`. Raises InputError when there are others, or T is not rigid."""
    if len(numbers) != 12:
        raise InputError(f'{file}: expected the 12 numbers of a 3 x 4 matrix, found {len(numbers)}')
    T = np.eye(4)
    T[:3] = np.reshape(numbers, (3, 4))
    if not are_rigid(T[None])[0]:
        raise InputError(f'{file}: expected a rotation and a translation, found {T[:3].tolist()}')
    return T


def in_kitti_world(poses, frame, extrinsic=None) -> np.ndarray:
    """T_world_lidar in KITTI's world, of poses as a file has them.

    frame: 'lidar': the world has z up, and the poses are the lidar's. 'camera': the world has KITTI's axes already, and the
    poses are the camera's. extrinsic: T_body_lidar, when the poses are of something else (IMU, another camera).
    """
    if frame not in FRAMES:
        raise UsageError(f'frame of the poses: expected one of {", ".join(FRAMES)}, found {frame!r}')
    if frame == 'camera':
        return poses @ (AXES_OF_CAMERA if extrinsic is None else extrinsic)
    return AXES_OF_CAMERA @ poses @ (np.eye(4) if extrinsic is None else extrinsic)


def in_frame(pose, frame) -> np.ndarray:
    """T_world_lidar of KITTI's world, in the world that a file of `frame` has."""
    return pose if frame == 'camera' else AXES_OF_CAMERA.T @ pose


def nearest(times, wanted):
    """Index of the time nearest to each wanted one, and how far it is away. times: ascending."""
    after = np.clip(np.searchsorted(times, wanted), 1, max(1, len(times) - 1))
    after = np.minimum(after, len(times) - 1)
    before = np.maximum(after - 1, 0)
    index = np.where(abs(times[before] - wanted) <= abs(times[after] - wanted), before, after)
    return index, abs(times[index] - wanted)


def matched(trajectory, frames, times, max_gap) -> np.ndarray:
    """The trajectory's pose of every scan, [n][4][4]. InputError saying how many scans have none.

    frames: of the scans, ascending. times: of the scans [s], or None. max_gap: [s].
    """
    if trajectory.times is None:
        if frames[-1] >= len(trajectory.poses):
            raise InputError(f'{trajectory.file}: holds {len(trajectory.poses)} poses (frames 0 to '
                             f'{len(trajectory.poses) - 1}), but the last scan is frame {frames[-1]}')
        return trajectory.poses[np.asarray(frames)]
    if times is None or any(time is None for time in times):
        raise InputError(f'{trajectory.file}: its poses belong to times, and the scans have none; give poses in KITTI\'s form')
    times = np.asarray(times)
    index, gaps = nearest(trajectory.times, times)
    lost = gaps > max_gap
    if lost.any():
        worst = int(gaps.argmax())
        raise InputError(
            f'{trajectory.file}: {lost.sum()} of {len(times)} scans have no pose within {max_gap:g} s; frame {frames[worst]} is '
            f'{gaps[worst]:.3f} s off. The scans are from {times.min():.3f} to {times.max():.3f} s, the poses from '
            f'{trajectory.times[0]:.3f} to {trajectory.times[-1]:.3f} s')
    return trajectory.poses[index]


def quaternion(R) -> np.ndarray:
    """x, y, z, w of a rotation [3][3], w not negative."""
    R = np.asarray(R, np.float64)
    if R.shape != (3, 3):
        raise ValueError(f'expected a rotation [3][3], found an array of shape {R.shape}')
    # the largest of the four squares, so that nothing is divided by a small number
    squares = np.array([1 + 2 * R[i, i] - np.trace(R) for i in range(3)] + [1 + np.trace(R)])
    i = int(squares.argmax())
    q = np.empty(4)
    q[i] = squares[i]
    if i == 3:
        q[:3] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    else:
        j, k = (i + 1) % 3, (i + 2) % 3
        q[3], q[j], q[k] = R[k, j] - R[j, k], R[j, i] + R[i, j], R[k, i] + R[i, k]
    return q / (np.linalg.norm(q) * (-1 if q[3] < 0 else 1))


def tum_line(time, pose) -> str:
    """time x y z qx qy qz qw"""
    q = quaternion(pose[:3, :3])
    return ' '.join([f'{time:.6f}', *(f'{value:.6f}' for value in pose[:3, 3]), *(f'{value:.9f}' for value in q)])
