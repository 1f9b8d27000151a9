"""Features of scans: sensors, range images, networks, ring descriptors, Scan Context, M2DP, PCA."""

import contextlib
import os
import tempfile
from pathlib import Path

import numpy as np

from revisit._core.recognition import (
    Alignment, FeatureExtractor, ImageGeometry, PcaFolder, PcaResult, RingModel, ScanContextOptions, ScanFeature, Sensor,
    SensorFound, choose_ring_model, context_distance, cosine, find_sensor, fit_pca_of_files, from_scan, m2dp_features,
    network_features, parse_mount, principal_alignment, project, range_vector_features, read_ring_model, ring_net, ring_recognizer,
    scan_context, scan_context_features, scan_frame_error, scan_to_image, sensor_geometry, sensors, shipped_ring_model,
    shipped_ring_models, shipped_ring_sensor)

__all__ = [
    'Alignment', 'FeatureExtractor', 'ImageGeometry', 'PcaModel', 'PcaResult', 'RingModel', 'ScanContextOptions',
    'ScanFeature', 'Sensor', 'SensorFound', 'choose_ring_model', 'context_distance', 'cosine', 'find_sensor', 'fit_pca', 'from_scan',
    'm2dp_features', 'network_features', 'parse_mount', 'principal_alignment', 'project', 'range_vector_features',
    'read_ring_model', 'ring_net', 'ring_recognizer', 'scan_context', 'scan_context_features', 'scan_frame_error',
    'scan_to_image', 'sensor_geometry', 'sensors', 'shipped_ring_model', 'shipped_ring_models',
    'shipped_ring_sensor']


@contextlib.contextmanager
def _files(features):
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


def fit_pca(features, components: int = 400, *, fit_rows=None, model_folder: str | os.PathLike | None = None,
            memory_gb: float = 2, threads: int = 1) -> PcaResult:
    """Fits principal components and projects all rows.

    features: float32 [n][d], a .npy file of such an array, or a list of either, whose rows are numbered consecutively.
    fit_rows: rows to fit; None: all.
    model_folder: folder to create, with the model for PcaModel.
    Raises UsageError for invalid values, InputError for features that are not finite or differ in dimensions.
    """
    with _files(features) as files:
        return fit_pca_of_files(files, components, [] if fit_rows is None else [int(row) for row in fit_rows],
                                model_folder, memory_gb, threads)


class PcaModel(PcaFolder):
    """Model of fit_pca(model_folder=...) or `revisit eval`: `mean.npy` [d] and `basis.npy` [k][d].

    PcaModel(folder) raises InputError if the files are missing or their shapes differ.
    """

    def project(self, features, components: int | None = None, *, threads: int = 1) -> np.ndarray:
        """Returns (x - mean) basis^T of all rows: float32 [n][components]. Takes features as fit_pca()."""
        with _files(features) as files:
            return super().project(files, self.components if components is None else components, threads)
