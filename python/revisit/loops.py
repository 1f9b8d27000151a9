"""Online loop detection in any recording that revisit.recordings reads, as `revisit loops` does it."""

from typing import NamedTuple

import numpy as np

from revisit import datasets
from revisit.errors import InputError
from revisit.maps import Detection, Loop
from revisit.recordings import Scan

__all__ = ['Visit', 'recognize']


class Visit(NamedTuple):
    """A scan with its detection."""
    scan: Scan
    found: Detection
    points: np.ndarray | None

    @property
    def index(self) -> int | None:
        """Index in the recognizer; None if the scan was not stored."""
        return self.found.index

    @property
    def loop(self) -> Loop | None:
        """The most similar map entry."""
        return self.found.loop

    @property
    def error(self) -> str:
        """Reason why the scan could not be read or described; '' if it was."""
        error = self.found.error
        return f'{self.scan.source}: {error}' if error and self.points is not None else error

    @property
    def registered(self):
        """Relative pose to the map entry; None if the loop is too dissimilar for registration."""
        return self.found.registered

    @property
    def accepted(self) -> bool:
        """The scan closes a loop. A registered loop must also be accepted by registration."""
        return self.loop is not None and self.loop.accepted


def recognize(scans, detector, deskew=True):
    """Passes the scans to a LoopDetector and yields a Visit for each.

    deskew: remove the motion distortion of scans with times of points, if they and the previous scan have times and poses.
    If a scan cannot be read or described, its Visit has the error. Raises UsageError if the scans lack what the exclusion
    needs, and the exceptions of the recording and the recognizer.
    """
    before = None
    for scan in scans:
        try:
            points, times = scan.timed()
        except InputError as error:
            yield Visit(scan, Detection(str(error)), None)
            continue
        if scan.pose is not None and scan.time is not None:
            if deskew and times is not None and before and scan.time > before.time:
                points = datasets.deskew(points, times, np.linalg.inv(before.pose) @ scan.pose, scan.time - before.time)
            before = scan
        yield Visit(scan, detector.take(points, frame=scan.frame, time=scan.time, pose=scan.pose), points)
