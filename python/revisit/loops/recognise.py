"""Every scan is described, compared with what was there before it, and added. As `revisit loops` does it."""

from typing import NamedTuple

import numpy as np

from revisit.errors import InputError
from revisit.maps import Loop
from revisit.recordings import Scan


class Visit(NamedTuple):
    """A scan and what the detector found."""
    scan: Scan
    position: int | None
    """In the recogniser; None for one that was not stored."""
    loop: Loop | None
    """The most similar place."""
    why_not: str
    """It could not be described: the reason."""
    points: np.ndarray | None
    registered: 'registration.Registration | None' = None
    """How the scan lies to the place, of a loop that the score accepts."""
    refusal: str = ''
    """Why the loop is not accepted."""

    @property
    def accepted(self) -> bool:
        """It is a loop; one that was registered also fits."""
        return self.loop is not None and self.loop.accepted


def recognise(scans, detector):
    """Hands the scans to the LoopDetector and yields a Visit for each.

    A scan that cannot be read or described is left out: its Visit says why. Raises UsageError for an exclusion that the scans
    know nothing of, what the recording raises when it ends early, and what the recogniser raises.
    """
    for scan in scans:
        try:
            points = scan.points()
        except InputError as error:
            yield Visit(scan, None, None, str(error), None)
            continue
        found = detector.take(points, frame=scan.frame, time=scan.time, pose=scan.pose)
        why_not = found.why_not and f'{scan.source}: {found.why_not}'
        yield Visit(scan, found.position, found.loop, why_not, points, found.registered, found.refusal)
