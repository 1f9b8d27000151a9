"""Simulated LiDAR drives through synthetic worlds, for users without data."""

from revisit._core.simulation import SimulationSummary, simulate

__all__ = ['SimulationSummary', 'simulate']
