"""Every scan is described, compared with what was there before it, and added. As `revisit loops` does it."""

from typing import NamedTuple

import numpy as np

from revisit import datasets
from revisit.errors import InputError
from revisit.maps import Detection, Loop
from revisit.recordings import Scan


class Visit(NamedTuple):
    """A scan and what the detector found."""
    scan: Scan
    found: Detection
    points: np.ndarray | None

    @property
    def position(self) -> int | None:
        """In the recogniser; None for one that was not stored."""
        return self.found.position

    @property
    def loop(self) -> Loop | None:
        """The most similar place."""
        return self.found.loop

    @property
    def why_not(self) -> str:
        """The scan could not be read or described: the reason."""
        why_not = self.found.why_not
        return f'{self.scan.source}: {why_not}' if why_not and self.points is not None else why_not

    @property
    def registered(self):
        """How the scan lies to the place, of a loop that is similar enough to be registered."""
        return self.found.registered

    @property
    def accepted(self) -> bool:
        """It is a loop; one that was registered also fits."""
        return self.loop is not None and self.loop.accepted


def recognise(scans, detector, deskew=True):
    """Hands the scans to the LoopDetector and yields a Visit for each.

    deskew: takes out the motion of scans that have times of points, and like the scan before them a time and a pose.
    A scan that cannot be read or described is left out: its Visit says why. Raises UsageError for an exclusion that the scans
    know nothing of, what the recording raises when it ends early, and what the recogniser raises.
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
