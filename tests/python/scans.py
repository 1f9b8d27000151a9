"""Synthetic scans: walls around a Velodyne HDL-64E."""

import numpy as np

from revisit import program


def room(seed, turn=0.0, shift=(0.0, 0.0)):
    """Returns float32 [n][4]. Each seed is another place. turn: yaw of the sensor [rad]."""
    rng = np.random.default_rng(seed)
    azimuth, elevation = np.meshgrid(np.linspace(-np.pi, np.pi, 900, endpoint=False),
                                     np.radians(np.linspace(2, -24.8, 64)))
    world = azimuth + turn
    distance = 15 + sum(a * np.cos(k * world + p) for k, a, p in zip(
        range(1, 9), rng.uniform(0.5, 3, 8), rng.uniform(0, 2 * np.pi, 8)))
    ground = 1.73 / np.maximum(np.tan(-elevation), 1e-3)
    distance = np.minimum(np.maximum(distance, 3), ground) / np.cos(elevation)
    x = distance * np.cos(elevation) * np.cos(azimuth) - shift[0]
    y = distance * np.cos(elevation) * np.sin(azimuth) - shift[1]
    z = distance * np.sin(elevation)
    return np.stack([x, y, z, np.full_like(x, 0.5)], -1).reshape(-1, 4).astype(np.float32)


def simulate(folder, **options):
    """Runs `revisit simulate` with options by their names."""
    program.run('simulate', '-o', folder, '-q', *(f'--{name}={value}' for name, value in options.items()))
