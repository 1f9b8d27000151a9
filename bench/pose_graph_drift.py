#!/usr/bin/env python3
"""Correction of realistic odometry drift by the pose graph of examples/slam.py, along KITTI's routes.

  pose_graph_drift.py KITTI/poses/00.txt KITTI/poses/08.txt ...     needs `pip install '.[slam]'`

No scans are simulated. Keyframes are 2 m apart. Odometry is the ground truth with a yaw drift to the left, a scale error (both in
the column headers), and noise in roll and pitch. Loops are the ground truth with the noise of registrations (1 cm, 0.02 degrees),
from 6 of 10 keyframes that are within 5 m of one at least 40 m earlier. Some drives also have 20 consecutive incorrect loops, as in
repetitive streets. Prints the absolute trajectory error [m] of odometry and of the corrected trajectory.
"""

import sys
from pathlib import Path
from types import SimpleNamespace

import gtsam
import numpy as np
from revisit import poses

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'examples'))
import slam  # noqa: E402

DRIFTS = [(0.002, 0.002, 0), (0.005, 0.005, 0), (0.01, 0.01, 0), (0.01, 0.01, 20), (0.02, 0.01, 0)]
"""Yaw drift [degrees / m], relative scale error, number of incorrect loops."""
SIGMAS = np.radians([0.573, 0.573, 0.573, 0.02, 0.02, 0.02])  # standard deviations of a loop: [m], [rad]


def turned(w):
    pose = np.eye(4)
    pose[:3, :3] = gtsam.Rot3.Expmap(w).matrix()
    return pose


def keyframes(file):
    path = poses.AXES_OF_CAMERA.T @ poses.read_trajectory(file)[1] @ poses.AXES_OF_CAMERA  # z up
    kept = [0]
    for i, pose in enumerate(path):
        if np.linalg.norm(pose[:3, 3] - path[kept[-1]][:3, 3]) >= 2:
            kept.append(i)
    return path[kept]


def loops_of(truth, rng):
    along = np.r_[0, np.cumsum(np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1))]
    loops = []
    for query in np.flatnonzero(along > 40):
        distances = np.linalg.norm(truth[along < along[query] - 40, :3, 3] - truth[query, :3, 3], axis=1)
        place, error = int(distances.argmin()), rng.normal(size=6) * SIGMAS
        if distances[place] < 5 and rng.random() < 0.6:
            wrong_by = turned(error[3:])
            wrong_by[:3, 3] = error[:3]
            loops.append((place, int(query), SimpleNamespace(
                T_place_query=np.linalg.inv(truth[place]) @ truth[query] @ wrong_by, information=np.diag(SIGMAS ** -2.0))))
    return loops


def drifted(truth, turn, longer, rng):
    path = [np.eye(4)]
    for before, after in zip(truth, truth[1:]):
        step = np.linalg.inv(before) @ after
        length = np.linalg.norm(step[:3, 3])
        step[:3, 3] *= 1 + longer
        path.append(path[-1] @ step @ turned([*rng.normal(size=2) * np.radians(0.01) * length ** 0.5, np.radians(turn) * length]))
    return np.array(path)


def main():
    print('| route | loops | ' + ' | '.join(f'{turn} deg/m, {100 * longer:g} %' + (f', {wrong} wrong' if wrong else '')
                                          for turn, longer, wrong in DRIFTS) + ' |')
    for file in sys.argv[1:]:
        rng = np.random.default_rng(1)
        truth = keyframes(file)
        loops, cells = loops_of(truth, rng), []
        for turn, longer, n_wrong in DRIFTS:
            path = drifted(truth, turn, longer, rng)
            same = SimpleNamespace(T_place_query=np.eye(4), information=np.diag(SIGMAS ** -2.0))
            wrong = [(len(truth) // 5 + i, len(truth) // 2 + i, same) for i in range(n_wrong)]
            errors = [slam.fitted(each, truth, False)[1] for each in (path, slam.optimized(path, loops + wrong))]
            cells.append('{:.1f} -> {:.2f}'.format(*errors))
        print(f'| {Path(file).stem} | {len(loops)} | ' + ' | '.join(cells) + ' |', flush=True)


if __name__ == '__main__':
    main()
