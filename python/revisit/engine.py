"""Caffe networks on the CPU: Net.load() -> Net.plan() -> Plan.run() -> Run.forward()."""

from revisit._core.engine import (
    LayerCost, Net, Plan, Precision, Profile, ReceptiveField, Run, Timing, filled, layer_types, port_name,
    profile)

__all__ = [
    'LayerCost', 'Net', 'Plan', 'Precision', 'Profile', 'ReceptiveField', 'Run', 'Timing', 'filled',
    'layer_types', 'port_name', 'profile']
