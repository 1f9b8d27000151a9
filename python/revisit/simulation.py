"""Drives through synthetic worlds, scanned by a LiDAR: data for users who have none."""

from revisit._core.simulation import SimulationSummary, simulate

__all__ = ['SimulationSummary', 'simulate']
