"""Places, kept in a file or on a server, and recognised."""

import os

from revisit import recognition
from revisit._core.maps import (
    Description, Detection, Loop, LoopDetector, LoopSummary, MapStore, PlaceRecognizer, PoseGraphWriter, StoredPlace, check_exclusion,
    check_map, maker_of, merge_maps)

__all__ = [
    'Description', 'Detection', 'Loop', 'LoopDetector', 'LoopSummary', 'MapStore', 'PlaceRecognizer', 'PoseGraphWriter',
    'StoredPlace', 'check_exclusion', 'check_map', 'maker_of', 'merge_maps', 'open_map']

KEY_CANDIDATES = 1000
"""As in `revisit loops`: how many places are compared, those with the most similar keys."""
PRECISION = 0.95


def open_map(file: str | os.PathLike | None = None, sensor: str | None = None, *,
             model: recognition.RingModel | None = None, threshold: float | None = None,
             precision: float = PRECISION, first_stretch: int = 128, threads: int = 1, mount: str = '',
             local_map: float = 0) -> PlaceRecognizer:
    """A recogniser by rings whose places are in `file`, made when it is missing; None: nowhere.

    sensor: whose model comes with the library (recognition.shipped_ring_models()); None: that of the map, of a new one hdl64.
    model: another one, as `revisit train` writes them (recognition.read_ring_model()).
    threshold, precision: of query(): from which score a loop is accepted; None: from where this share of the accepted loops is
        right, as far as the calibration of the map or the model holds. LoopDetector has its own of loops that it registers.
    first_stretch: how many places rings learn their mean from.
    threads: of describing one scan.
    local_map: LoopDetector's, which must be the same for a map.
    mount: 'roll,pitch,yaw,x,y,z' [deg, m], recognition.parse_mount(); '': the points' z is up.
    `revisit loops --map` reads and writes the same maps.
    """
    if model is None:
        of_map = recognition.shipped_ring_sensor(maker_of(file)) if file is not None and sensor is None else ''
        model = recognition.shipped_ring_model(sensor or of_map or 'hdl64')
    extractor = recognition.ring_recogniser(model, key_candidates=KEY_CANDIDATES, threads=threads)
    store = None
    if file is not None:
        store = MapStore.open(file, PlaceRecognizer.identity_of(extractor, local_map=local_map))
    return PlaceRecognizer(extractor, store, threshold=threshold, precision=precision, first_stretch=first_stretch,
                           mount=recognition.parse_mount(mount) if mount else None, local_map=local_map)
