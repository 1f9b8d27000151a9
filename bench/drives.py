"""Drives with known revisits, and metrics of a method's answers.

A query is a keyframe; its candidates are the first keyframes of the drive. An answer is (query, place, score, accepted); place is
None if the method found none, accepted is None if the method has no threshold.
"""

import csv
import tempfile
from pathlib import Path

import numpy as np

RADIUS, NEGATIVE_RADIUS = 5, 10
"""Planar distances [m]: nearer is correct, farther incorrect, in between ignored."""
RECENT = 50
"""Path length before a keyframe that is excluded from its candidates [m]."""
BLOCK = 100, 50
"""Bootstrap blocks: path length [m]; number of keyframes of a drive without poses."""


class Drive:
    """files: scans in order. poses: T_world_sensor [n][4][4], or None. candidates [n]: number of first keyframes that may match.
    starts: first keyframes of laps. blocks [n]: bootstrap blocks."""

    def __init__(self, name, files, poses=None):
        self.name, self.files, self.poses, self.starts = name, [Path(file) for file in files], poses, {0}
        self.blocks = np.arange(len(self.files)) // BLOCK[1]
        self.made = None  # temporary folder, deleted with the drive

    def queries(self):
        return np.nonzero(self.candidates > 0)[0]


class DriveWithPoses(Drive):
    def __init__(self, name, files, poses, up=2):
        """up: vertical axis of the world."""
        super().__init__(name, files, poses)
        self.up = up
        self.at = np.delete(poses[:, :3, 3], up, 1)
        path = np.r_[0, np.cumsum(np.linalg.norm(np.diff(self.at, axis=0), axis=1))]
        self.blocks = (path // BLOCK[0]).astype(int)
        self.candidates = np.searchsorted(path, path - RECENT)
        self.nearest = np.array([np.linalg.norm(self.at[:n] - here, axis=1).min() if n else np.inf
                                 for n, here in zip(self.candidates, self.at)])

    def keyframes(self, meters):
        kept = [0]
        for i, here in enumerate(self.at):
            if np.linalg.norm(here - self.at[kept[-1]]) >= meters:
                kept.append(i)
        drive = DriveWithPoses(self.name, [self.files[i] for i in kept], self.poses[kept], self.up)
        drive.made = self.made
        return drive

    def has_place(self, query):
        """Whether a candidate is correct; None if unknown."""
        distance = self.nearest[query]
        return None if RADIUS <= distance < NEGATIVE_RADIUS else bool(distance < RADIUS)

    def is_correct(self, query, place):
        distance = np.linalg.norm(self.at[query] - self.at[place])
        return None if RADIUS <= distance < NEGATIVE_RADIUS else bool(distance < RADIUS)


class TwoLaps(Drive):
    """Two laps. Files of pairs list the places of the second lap in the first (columns query and place: lap/number)."""

    FILES = 'loops.csv', 'loops_weak.csv', 'loops_by_time.csv'
    NEAR = 2  # keyframes within this distance of a listed place are correct, too
    CERTAIN = {'riverside': 131}  # number of first queries of the second lap whose places are completely listed

    def __init__(self, folder):
        laps = [sorted(file for file in (folder / lap).iterdir() if file.suffix in ('.bin', '.pcd')) for lap in ('first', 'second')]
        super().__init__(folder.name, sum(laps, []))
        size = len(laps[0])
        self.candidates = np.r_[np.zeros(size, int), np.full(len(laps[1]), size)]
        self.starts = {0, size}
        row = {f'{file.parent.name}/{file.stem}': i for i, file in enumerate(self.files)}
        self.places = {}
        for file in filter(Path.exists, (folder / name for name in self.FILES)):
            for pair in csv.DictReader(file.read_text().splitlines()):
                self.places.setdefault(row[pair['query']], set()).add(row[pair['place']])
        self.first_open = size + self.CERTAIN.get(folder.name, 0)

    def has_place(self, query):
        return True if query in self.places else False if query < self.first_open else None

    def is_correct(self, query, place):
        return any(abs(place - known) <= self.NEAR for known in self.places.get(query, ()))


def open_drive(folder):
    """Opens bin/ with poses_kitti.txt (z up), first/ and second/ with lists of pairs, KITTI's layout, or simulates town:SEED."""
    if str(folder).startswith('town:'):
        from revisit import program
        made = tempfile.TemporaryDirectory()
        program.run('simulate', '-o', made.name, '--sensor', 'vlp16', '--route', 'both', '--length', 300, '--every', 4, '--seed', int(str(folder)[5:]))
        drive = open_drive(made.name)
        drive.name, drive.made = str(folder), made
        return drive
    folder = Path(folder)
    if (folder / 'first').is_dir():
        return TwoLaps(folder)
    if (folder / 'poses_kitti.txt').exists():
        poses = np.tile(np.eye(4), (len(files := sorted((folder / 'bin').glob('*.bin'))), 1, 1))
        rows = np.loadtxt(folder / 'poses_kitti.txt').reshape(-1, 3, 4)
        poses[:, :3] = [rows[int(file.stem)] for file in files]
        return DriveWithPoses(folder.name, files, poses)
    from revisit import datasets
    from revisit.poses import read_extrinsic
    data = datasets.open_dataset(folder, poses=True)
    calibration = read_extrinsic(data.scans[0].file.parents[1] / 'calib.txt')
    return DriveWithPoses(folder.name, [scan.file for scan in data.scans],
                          np.array([scan.pose for scan in data.scans]) @ calibration, up=1)


def figures(drive, answers):
    from revisit import evaluation
    placed = {query: drive.has_place(query) for query, *_ in answers}
    right = {query: None if place is None else drive.is_correct(query, place) for query, place, *_ in answers}
    kept = [a for a in answers if placed[a[0]] is not None and (a[1] is None or right[a[0]] is not None)]
    with_place = [a for a in answers if placed[a[0]]]
    lowest = min((a[2] for a in kept), default=0) - 1  # score of queries without an answer
    labels = evaluation.labels([lowest if a[1] is None else a[2] for a in kept], [right[a[0]] is True for a in kept],
                               [placed[a[0]] for a in kept])
    found = evaluation.summarize(labels)
    interval = evaluation.bootstrap(labels, blocks=[int(drive.blocks[a[0]]) for a in kept]).average_precision
    result = {'queries': len(answers), 'with_place': len(with_place), 'ap': found.average_precision,
              'ap_interval': None if np.isnan(interval[0]) else [round(end, 4) for end in interval],  # None: a single block
              'recall_at_1': sum(right[a[0]] is True for a in with_place) / max(1, len(with_place)),
              'recall_at_precision_1': found.max_recall_at_precision_1}
    if any(a[3] is not None for a in answers):
        accepted = [a for a in answers if a[3] and a[1] is not None]
        open_ones = isinstance(drive, TwoLaps)  # the ground truth of unlisted queries is unknown
        result['accepted_correct'] = sum(right[a[0]] is True for a in accepted)
        result['accepted_incorrect'] = sum(right[a[0]] is False and not (open_ones and placed[a[0]] is None) for a in accepted)
    return result
