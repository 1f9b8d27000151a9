"""Every scan is described, compared with what was there before it, and added. As `revisit loops` does it."""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from revisit.errors import InputError, UsageError
from revisit.maps import Loop
from revisit.recordings import Scan

KINDS = ('frames', 'seconds', 'metres', 'none')


class Exclusion(NamedTuple):
    """Which scans of the drive are of the same moment, and not loops."""
    kind: str = 'frames'
    amount: float = 50

    @staticmethod
    def parse(text) -> 'Exclusion':
        """frames=50, seconds=30, metres=50 or none."""
        kind, _, amount = text.partition('=')
        try:
            number = 0.0 if text == 'none' else float(amount)
        except ValueError:
            number = math.nan
        whole = kind != 'frames' or number == math.floor(number) if math.isfinite(number) else False
        if kind not in KINDS or (kind == 'none') != (text == 'none') or not whole or number < 0:
            raise UsageError('exclusion: expected frames=N, seconds=T, metres=L (not negative) or none, '
                             f'found {text!r}')
        return Exclusion(kind, number)


class Visit(NamedTuple):
    """What became of one scan."""
    scan: Scan
    position: int | None
    """In the recogniser; None for one that was not described."""
    loop: Loop | None
    """The place most like it."""
    why_not: str
    """It was not described."""
    points: np.ndarray | None
    registered: 'registration.Registration | None' = None
    """How the scan lies to the place, when that was asked for."""

    @property
    def accepted(self) -> bool:
        """It is a loop; one that was registered also fits."""
        return self.loop is not None and self.loop.accepted and (self.registered is None or self.registered.accepted)


def ways_driven(kind):
    """A function: how far along its drive a scan is, in frames, seconds or metres."""
    last, driven = None, 0.0

    def at(scan):
        nonlocal last, driven
        if kind == 'seconds':
            if scan.time is None:
                raise UsageError('exclusion in seconds: the scans have no times; use frames=N')
            return scan.time
        if kind != 'metres':
            return scan.frame
        if scan.pose is None:
            raise UsageError(f'exclusion in metres: {scan.source} has no pose; use frames=N')
        here = scan.pose[:3, 3]
        driven += 0 if last is None else float(np.linalg.norm(here - last))
        last = here
        return driven
    return at


def recognise(scans, recognizer, exclusion=Exclusion(), drive='', verify=False):
    """Yields a Visit for each of the scans. `drive` is its name in the map.

    verify: registers accepted loops to places of this drive, for which half a megabyte of each scan is kept.
    A scan that cannot be read or described is left out: its Visit says why. Raises UsageError for an exclusion that the scans
    know nothing of, what the recording raises when it ends early, and what the recogniser raises.
    """
    if verify:
        from revisit import registration
    prepared = {}  # by position in the recogniser
    recent = deque()  # (position, how far along), of the same moment
    along_of = ways_driven(exclusion.kind)
    for scan in scans:
        along = along_of(scan)
        while recent and (exclusion.kind == 'none' or along - recent[0][1] > exclusion.amount):
            recent.popleft()
        try:
            points = scan.points()
            description = recognizer.describe(points)
        except InputError as error:
            yield Visit(scan, None, None, str(error), None)
            continue
        if not description.described:
            yield Visit(scan, None, None, f'{scan.source}: {description.why_not}', points)
            continue
        recognizer.refresh_on_news()
        loop = recognizer.query(description, [position for position, _ in recent])
        position = recognizer.add(description, drive=drive, frame=scan.frame, time=scan.time, pose=scan.pose)
        recent.append((position, along))
        registered = None
        if verify:
            prepared[position] = registration.PreparedScan(points)
            if loop is not None and loop.accepted and loop.turn is not None and loop.position in prepared:
                registered = registration.register_scans(prepared[position], prepared[loop.position], loop.turn)
        yield Visit(scan, position, loop, '', points, registered)
