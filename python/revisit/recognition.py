"""Features of scans: sensors, range images, networks, ring descriptors, Scan Context, M2DP, PCA."""

from revisit._core.recognition import (
    Alignment, FeatureExtractor, ImageGeometry, PcaResult, RingModel, ScanContextOptions, ScanFeature, Sensor,
    SensorFound, choose_ring_model, context_distance, cosine, find_sensor, from_scan, m2dp_features, network_features,
    parse_mount, principal_alignment, project, range_vector_features, read_ring_model, ring_net, ring_recognizer,
    scan_context, scan_context_features, scan_frame_error, scan_to_image, sensor_geometry, sensors, shipped_ring_model,
    shipped_ring_models, shipped_ring_sensor)
from revisit._pca import PcaModel, fit_pca

__all__ = [
    'Alignment', 'FeatureExtractor', 'ImageGeometry', 'PcaModel', 'PcaResult', 'RingModel', 'ScanContextOptions',
    'ScanFeature', 'Sensor', 'SensorFound', 'choose_ring_model', 'context_distance', 'cosine', 'find_sensor', 'fit_pca', 'from_scan',
    'm2dp_features', 'network_features', 'parse_mount', 'principal_alignment', 'project', 'range_vector_features',
    'read_ring_model', 'ring_net', 'ring_recognizer', 'scan_context', 'scan_context_features', 'scan_frame_error',
    'scan_to_image', 'sensor_geometry', 'sensors', 'shipped_ring_model', 'shipped_ring_models',
    'shipped_ring_sensor']
