"""Maps in files or on servers, place recognition and loop detection."""

import os

from revisit import recognition
from revisit._core.maps import (
    Description, Detection, Loop, LoopDetector, Map, MapEntry, MapStore, check_map, feature_key_of, merge_maps)

__all__ = [
    'Description', 'Detection', 'Loop', 'LoopDetector', 'Map', 'MapEntry', 'MapStore', 'check_map', 'feature_key_of',
    'merge_maps', 'open_map']


def open_map(file: str | os.PathLike[str] | None = None, sensor: str | None = None, *,
             model: recognition.RingModel | None = None, warmup: int = 128, threads: int = 1, mount: str = '',
             local_map: float = 0) -> Map:
    """Opens the map `file` of ring descriptors, or a server's address. It is created if missing; None: a temporary map.

    sensor: of a model from recognition.shipped_ring_models(); None: that of the map, else the nearest to the first scan with at
        least 500 returns, or hdl64 for local maps. Map.warnings then has a message.
    model: another model, from recognition.read_ring_model().
    warmup: number of scans from which the map mean is estimated.
    threads: for describing one scan.
    local_map: LoopDetector describes and registers the points of the last `local_map` meters, accumulated by the poses or else
        by registration; 0: single scans. The same for all sessions of a map.
    mount: 'roll,pitch,yaw,x,y,z' [deg, m], see recognition.parse_mount(); '': x forward, y left, z up.
    `revisit loops --map` reads and writes the same maps.
    Raises InputError if the file is not a map, is corrupt, or has another sensor or local_map, and Error if another process
    writes to it.
    """
    extractor = None if model is None else recognition.ring_recognizer(model, candidates=1000, threads=threads)  # as in C++
    return Map(file, sensor, extractor=extractor, warmup=warmup, threads=threads, local_map=local_map,
               mount=recognition.parse_mount(mount) if mount else None)
