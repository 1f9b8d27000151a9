"""Drives for foreign methods, judged as `revisit eval` judges its own in driving order (docs/reference/EVALUATION.md).

Queries and candidates are those of the protocol `online`, but only keyframes are candidates. An answer to a query is
(place, score, accepted): place is None if the method found none, accepted is None if the method has no threshold.
"""

from pathlib import Path

import numpy as np
from revisit import datasets, evaluation, poses

RADIUS = 5
"""Of a correct match [m]."""


class Drive:
    """files: scans in order. starts: first scans of folders. poses: T_world_sensor [n][4][4], or None. at [n][2]:
    horizontal position [m]. stored: rows of keyframes. queries: rows. candidates: of each query, the number of `stored` that may
    match."""

    def __init__(self, scans, positions=None, poses=None, listed=None, exclusion='frames=50', keyframes=0, negative_radius=2 * RADIUS,
                 camera_axes=False):
        self.files, self.frames = [Path(scan.file) for scan in scans], [scan.frame for scan in scans]
        self.starts = [i for i, file in enumerate(self.files) if i == 0 or file.parent != self.files[i - 1].parent]
        self.poses, self.listed, self.negative_radius = poses, listed, negative_radius
        self.at = None if positions is None else positions[:, [0, 2 if camera_axes else 1]]
        trajectory = evaluation.Trajectory(self.frames, positions, camera_axes=camera_axes)
        trajectory.listed = listed
        task, = evaluation.make_tasks('online', '', trajectory, exclusion=exclusion)
        self.queries, self.blocks = task.queries, evaluation.blocks_of(task, trajectory)
        self.stored = [0]
        for i in range(1, len(scans)):
            if not keyframes or np.linalg.norm(positions[i] - positions[self.stored[-1]]) >= keyframes:
                self.stored.append(i)
        self.stored = np.array(self.stored)
        self.candidates = np.searchsorted(self.stored, [len(task.candidates(i)) for i in range(len(self.queries))])

    def label(self, query, places):
        """Returns whether each match is correct, and whether it is ignored."""
        if self.listed:
            def has(one, other):
                return self.frames[other] in self.listed.correct.get(self.frames[one], ())
            return np.array([has(query, place) or has(place, query) for place in places]), np.zeros(len(places), bool)
        distance = np.linalg.norm(self.at[places] - self.at[query], axis=1)
        return distance < RADIUS, (distance >= RADIUS) & (distance <= self.negative_radius)


def open_drive(data, *, trajectory=None, pairs='', keyframes='meters=0', **rule):
    """Opens scans as `revisit eval` does: of KITTI's layout, with a file of poses of the lidar, or with pairs (FILE,...,near=N)."""
    rule['keyframes'] = float(keyframes.partition('=')[2])
    if pairs:
        scans, listed, near = datasets.open_dataset(data), {}, 0
        for part in pairs.split(','):
            near = int(part[5:]) if part.startswith('near=') else near
        for part in pairs.split(','):
            for query, places in (() if part.startswith('near=') else evaluation.read_pairs(part, scans, near).items()):
                listed[query] = listed.get(query, set()) | places
        return Drive(scans.scans, listed=evaluation.ListedPairs(listed), **rule)
    if trajectory:
        scans = datasets.open_dataset(data).scans
        found = poses.read_trajectory(trajectory)[1][[scan.frame for scan in scans]]
        return Drive(scans, found[:, :3, 3].copy(), found, **rule)
    scans = datasets.open_dataset(data, poses=True).scans
    of_camera = np.array([scan.pose for scan in scans])
    return Drive(scans, of_camera[:, :3, 3].copy(), of_camera @ poses.read_extrinsic(scans[0].file.parents[1] / 'calib.txt'),
                 camera_axes=True, **rule)


def metrics(drive, answers):
    """The metrics of answers to all queries, named as in run.json."""
    lowest = min((score for place, score, _ in answers if place is not None), default=0) - 1
    rows, accepted = [], {'correct': 0, 'ignored': 0, 'incorrect': 0}
    for query, n, (place, score, accepts) in zip(drive.queries, drive.candidates, answers):
        (correct,), (ignored,) = ([False], [False]) if place is None else drive.label(query, [place])
        rows.append((lowest if place is None else score, correct, drive.label(query, drive.stored[:n])[0].any(), ignored))
        if accepts and place is not None:
            accepted['correct' if correct else 'ignored' if ignored else 'incorrect'] += 1
    labels = evaluation.labels(*zip(*rows))
    found = evaluation.summarize(labels)
    interval = evaluation.bootstrap(labels, blocks=drive.blocks).average_precision
    result = {key: getattr(found, key) for key in ('n_queries', 'n_positives', 'average_precision', 'recall_at_1', 'max_recall_at_precision_1')}
    result['average_precision_ci'] = [] if np.isnan(interval[0]) else list(interval)
    blocks = np.array(drive.blocks)
    result |= {'bootstrap_blocks': len(set(blocks)), 'bootstrap_positive_blocks': len(set(blocks[[row[2] for row in rows]]))}
    return result | ({'loops': accepted} if any(accepts is not None for *_, accepts in answers) else {})
