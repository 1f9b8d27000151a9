"""Reader of a site's cloud in ASPRS LAS: parts of a million points, whose poses are their shifts."""

import numpy as np

from revisit.recordings.recording import Recording, Scan, package

POINTS = 1_000_000
"""Of a part."""


def detects(path):
    return path.is_file() and path.suffix.lower() in ('.las', '.laz')


def open_las(path) -> Recording:
    laspy = package('laspy', 'laspy[lazrs]', f'{path}: reading LAS')

    def scans():
        with laspy.open(path) as file:
            pose = np.eye(4)
            pose[:3, 3] = np.floor(file.header.mins)
            for frame, part in enumerate(file.chunk_iterator(POINTS)):
                points = (np.stack([part.x, part.y, part.z], 1) - pose[:3, 3]).astype(np.float32)
                yield Scan(frame, None, pose, lambda points=points: (points, None), f'{path}, part {frame}')

    return Recording(path.stem, None, scans)
