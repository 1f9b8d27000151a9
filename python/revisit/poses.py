"""Trajectories in the formats of KITTI, TUM and EuRoC.

Poses are float64 [n][4][4], T_world_sensor, in meters. The world has the axes of the file: z up, or those of KITTI's camera (x
right, y down, z forward) in files of KITTI.
"""

import warnings

import numpy as np
from numpy.typing import NDArray

from revisit._core.datasets import read_extrinsic, read_trajectory
from revisit.errors import InputError

__all__ = ['AXES_OF_CAMERA', 'read_extrinsic', 'read_trajectory', 'rigid']
AXES_OF_CAMERA = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]], np.float64)
"""T_camera_lidar of a forward-looking camera, which converts its poses: T_world_camera @ AXES_OF_CAMERA is T_world_lidar."""


def rigid(translations: NDArray[np.float64], quaternions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns [n][4][4] of translations [n][3] and quaternions [n][4] (x, y, z, w, any norm); NaN for a zero quaternion."""
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
    """Returns bool [n]: the pose is a rigid transform, up to rounding in files with few digits."""
    R = poses[:, :3, :3]
    with np.errstate(all='ignore'):  # non-finite values fail the test
        off = abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max((1, 2))
        return (off < 1e-3) & (np.linalg.det(R) > 0) & np.isfinite(poses).all((1, 2))


def table_of(file, delimiter=None, holes=False):
    """Reads a text file of numbers, float64 [rows][columns]. Skips lines that begin with #.

    holes: skip rows with NaN instead of raising.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', UserWarning)  # numpy warns about an empty file, which raises below
            table = np.loadtxt(file, delimiter=delimiter, comments='#', ndmin=2)
    except (OSError, ValueError) as error:
        raise InputError(f'{file}: cannot be read as a table of numbers: {error}') from None
    if holes:
        table = table[~np.isnan(table).any(1)]
    if not table.size:
        raise InputError(f'{file}: is empty')
    if not np.isfinite(table).all():
        raise InputError(f'{file}: row {int(np.argmin(np.isfinite(table).all(1))) + 1} of the numbers: expected finite values')
    return table


def matrix_of(numbers, file) -> np.ndarray:
    """Returns T [4][4] from the 12 numbers of a 3 x 4 matrix. Raises InputError with `file` unless T is a rigid transform."""
    if len(numbers) != 12:
        raise InputError(f'{file}: expected the 12 numbers of a 3 x 4 matrix, found {len(numbers)}')
    T = np.eye(4)
    T[:3] = np.reshape(numbers, (3, 4))
    if not are_rigid(T[None])[0]:
        raise InputError(f'{file}: expected a rigid transform (rotation, translation), found {T[:3].tolist()}')
    return T


def nearest(times, wanted):
    """Returns the index of the time nearest to each wanted time, and their distance. times: ascending."""
    after = np.minimum(np.searchsorted(times, wanted), len(times) - 1)
    before = np.maximum(after - 1, 0)
    index = np.where(abs(times[before] - wanted) <= abs(times[after] - wanted), before, after)
    return index, abs(times[index] - wanted)
