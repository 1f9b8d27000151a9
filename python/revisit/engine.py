"""Caffe networks on the CPU: Net.load() -> Net.plan() -> Plan.run() -> Run.forward()."""

from revisit._core.engine import (
    BufferUse, LayerCost, Net, Plan, Precision, Profile, ReceptiveField, Run, Timing,
    blas_core, faster_blas_core, input_blobs, layer_types, port_name, profile, simd_target)

__all__ = [
    'BufferUse', 'LayerCost', 'Net', 'Plan', 'Precision', 'Profile', 'ReceptiveField',
    'Run', 'Timing', 'blas_core', 'faster_blas_core', 'input_blobs', 'layer_types', 'port_name',
    'profile', 'simd_target']
