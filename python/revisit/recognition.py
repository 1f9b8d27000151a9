"""Features of scans: sensors, range images, networks, ring descriptors, Scan Context, M2DP, PCA."""

import contextlib
import os
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from revisit._core.recognition import (
    Alignment, FeatureExtractor, ImageGeometry, PcaResult, RingModel, ScanContextOptions, ScanFeature, Sensor,
    choose_ring_model, cosine, fit_pca_of_files, from_scan, m2dp_features, network_features, parse_mount, principal_alignment,
    project, read_ring_model, ring_net, ring_recognizer, scan_context_features, scan_to_image, sensor_geometry, sensors,
    shipped_ring_model, shipped_ring_models, shipped_ring_sensor)

__all__ = [
    'Alignment', 'FeatureExtractor', 'ImageGeometry', 'PcaResult', 'RingModel', 'ScanContextOptions', 'ScanFeature',
    'Sensor', 'choose_ring_model', 'cosine', 'fit_pca', 'from_scan', 'm2dp_features', 'network_features', 'parse_mount',
    'principal_alignment', 'project', 'read_ring_model', 'ring_net', 'ring_recognizer', 'scan_context_features', 'scan_to_image',
    'sensor_geometry', 'sensors', 'shipped_ring_model', 'shipped_ring_models', 'shipped_ring_sensor']


_Rows = NDArray[np.float32] | str | os.PathLike[str]
_Features = _Rows | Sequence[_Rows]


@contextlib.contextmanager
def _files(features: _Features) -> Iterator[list[Path]]:
    """Yields names of .npy files with the features: an array [n][d], such a file, which may be larger than memory, or a list."""
    several = features if isinstance(features, (list, tuple)) else [features]
    with tempfile.TemporaryDirectory(prefix='revisit_pca_') as folder:
        names = []
        for number, part in enumerate(several):
            if isinstance(part, (str, os.PathLike)):
                names.append(Path(part))
                continue
            masked = isinstance(part, np.ma.MaskedArray)  # rejected, because masked values would be used
            if not isinstance(part, np.ndarray) or part.dtype != np.float32 or part.ndim != 2 or masked:
                found = (f'{part.dtype} {"masked " if masked else ""}array of shape {part.shape}' if isinstance(part, np.ndarray)
                         else type(part).__name__)
                raise TypeError(f'features: expected a float32 array [n][d] or a .npy file of one, found {found}')
            names.append(Path(folder, f'{number}.npy'))
            np.save(names[-1], np.ascontiguousarray(part))
        yield names


def fit_pca(features: _Features, components: int = 400, *, fit_rows: Iterable[int] | None = None,
            model_folder: str | os.PathLike[str] | None = None, memory_gb: float = 2, threads: int = 1) -> PcaResult:
    """Fits principal components and projects all rows.

    features: float32 [n][d], a .npy file of such an array, or a list of either, whose rows are numbered consecutively.
    fit_rows: rows to fit; None: all.
    memory_gb: limit of the working memory [GB].
    model_folder: folder to create, with mean.npy [d] and basis.npy [k][d]; descriptors are (x - mean) basis^T.
    Raises UsageError for invalid values, InputError for features that are not finite or differ in dimensions.
    """
    with _files(features) as files:
        return fit_pca_of_files(files, components, [] if fit_rows is None else [int(row) for row in fit_rows],
                                model_folder, memory_gb, threads)
