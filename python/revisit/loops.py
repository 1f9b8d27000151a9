"""Online loop detection in any recording that revisit.recordings reads, as `revisit loops` does it."""

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from revisit import datasets
from revisit.errors import InputError
from revisit.maps import Detection, LoopDetector
from revisit.recordings import Scan

__all__ = ['Visit', 'recognize']


class Visit(NamedTuple):
    """A scan with its detection. points: as they were recognized, [n][3 or more] [m]; None if the scan could not be read."""
    scan: Scan
    found: Detection
    points: NDArray[Any] | None


def recognize(scans: Iterable[Scan], detector: LoopDetector, deskew: bool = True) -> Iterator[Visit]:
    """Passes the scans to a LoopDetector and yields a Visit for each.

    deskew: remove the motion distortion of scans with times of points, if they and the previous scan have times and poses.
    If a scan cannot be read or described, its Visit has the error. Raises UsageError if the scans lack what the exclusion
    needs, and the exceptions of the recording and the map.
    """
    before = None
    for scan in scans:
        try:
            points, times = scan.read()
        except InputError as error:
            yield Visit(scan, Detection(str(error)), None)
            continue
        if scan.pose is not None and scan.time is not None:
            if deskew and times is not None and before and scan.time > before.time:
                points = datasets.deskew(points, times, np.linalg.inv(before.pose) @ scan.pose, scan.time - before.time)
            before = scan
        yield Visit(scan, detector.take(points, frame=scan.frame, time=scan.time, pose=scan.pose), points)
