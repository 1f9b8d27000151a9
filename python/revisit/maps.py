"""Maps in files or on servers, place recognition and loop detection."""

import os

from revisit import recognition
from revisit._core.maps import (
    Description, Detection, Loop, LoopDetector, MapEntry, MapStore, PlaceRecognizer, check_map, feature_key_of, merge_maps)

__all__ = [
    'Description', 'Detection', 'Loop', 'LoopDetector', 'MapEntry', 'MapStore', 'PlaceRecognizer', 'check_map', 'feature_key_of',
    'merge_maps', 'open_map']

CANDIDATES = 1000
"""Number of entries compared exactly, preselected by compact codes. Same as in `revisit loops`."""
TARGET_PRECISION = 0.95


def open_map(file: str | os.PathLike | None = None, sensor: str | None = None, *,
             model: recognition.RingModel | None = None, threshold: float | None = None,
             target_precision: float = TARGET_PRECISION, warmup: int = 128, threads: int = 1, mount: str = '',
             local_map: float = 0) -> PlaceRecognizer:
    """Opens a recognizer with ring descriptors and the map `file`, which is created if missing; None: no map.

    sensor: of a model from recognition.shipped_ring_models(); None: that of the map, hdl64 for a new map.
    model: another model, from recognition.read_ring_model().
    threshold: minimum score of accepted loops of query(); None: the score that reaches target_precision.
    target_precision: target fraction of accepted loops of query() that are correct, by the calibration of the map or the model.
        LoopDetector has its own threshold and target_precision, for registered loops.
    warmup: number of scans from which the map mean is estimated.
    threads: for describing one scan.
    local_map: must equal that of the LoopDetector [m], and be the same for all sessions of a map.
    mount: 'roll,pitch,yaw,x,y,z' [deg, m], see recognition.parse_mount(); '': x forward, y left, z up.
    `revisit loops --map` reads and writes the same maps.
    """
    if model is None:
        of_map = recognition.shipped_ring_sensor(feature_key_of(file)) if file is not None and sensor is None else ''
        model = recognition.shipped_ring_model(sensor or of_map or 'hdl64')
    extractor = recognition.ring_recognizer(model, candidates=CANDIDATES, threads=threads)
    store = None
    if file is not None:
        store = MapStore.open(file, PlaceRecognizer.fingerprint_of(extractor, local_map=local_map))
    return PlaceRecognizer(extractor, store, threshold=threshold, target_precision=target_precision, warmup=warmup,
                           mount=recognition.parse_mount(mount) if mount else None, local_map=local_map)
