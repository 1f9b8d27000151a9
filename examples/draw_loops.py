#!/usr/bin/env python3
"""Plots the loops of a drive on a map, and optionally a close-up of one loop with range images and headings.

  revisit loops drive --all --format jsonl -o loops.jsonl      # the drive needs poses
  draw_loops.py loops.jsonl -o loops.png
  revisit doctor drive/velodyne/000452.bin --align none --gamma 2 --images look       # scan 452; repeat for its place
  draw_loops.py loops.jsonl --frame 452 --images look -o loops.png

Needs numpy and matplotlib.
"""

import argparse
import json
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use('Agg')
import matplotlib.pyplot as plt

NOW, THEN, PATH, BLACK, WRONG = '#c2410c', '#1d4ed8', '#b0b7c0', '#111827', '#dc2626'
DIRECTIONS = (('opposite direction', 135, 181, '#15803d'), ('across', 45, 135, '#d39e00'), ('same direction', 0, 45, '#7c3aed'))


def read(file):
    """Returns the scans with a position, their top-down positions [m], and the path's heading there [rad]."""
    scans = [scan for scan in map(json.loads, file.read_text().splitlines()) if 'position' in scan]
    if len(scans) < 2:
        raise SystemExit(f'draw_loops: {file}: no positions, because the drive has no poses')
    at = np.array([(scan['position']['x'], scan['position']['z']) for scan in scans])  # x right, z forward
    along = np.gradient(at, axis=0)
    return scans, at, np.arctan2(along[:, 1], along[:, 0])


def evaluate(scans, at, exclusion, radius):
    """Returns accepted pairs (scan, place) within twice the radius, the other accepted pairs, and missed scans."""
    index = {scan['frame']: i for i, scan in enumerate(scans)}
    pairs = np.array([(i, index[scan['match_frame']]) for i, scan in enumerate(scans) if scan.get('accepted')], int).reshape(-1, 2)
    correct = np.hypot(*(at[pairs[:, 0]] - at[pairs[:, 1]]).T) < 2 * radius
    frames = np.array([scan['frame'] for scan in scans])
    missed = [i for i, scan in enumerate(scans) if not scan.get('accepted')
              and (np.hypot(*(at[frames < frames[i] - exclusion] - at[i]).T) < radius).any()]
    return pairs[correct], pairs[~correct], missed


def draw_image(axes, file, yaw, title, color):
    pixels = plt.imread(file)
    rotated = np.roll(pixels, round(yaw / 360 * pixels.shape[1]), axis=1)  # azimuth decreases with the column
    axes.imshow(rotated, cmap='gray', aspect='auto', interpolation='antialiased')
    axes.set_title(title, color=color, loc='left')
    axes.spines[:].set(color=color, linewidth=1.5)


def draw_map(axes, at, loops, yaw, wrong, missed):
    for name, low, high, color in DIRECTIONS:
        chosen = loops[(low <= abs(yaw)) & (abs(yaw) < high), 0]
        axes.scatter(*at[chosen].T, s=16, color=color, zorder=3, label=f'correct loop, {name}: {len(chosen)}')
    axes.scatter(*at[wrong[:, 0]].T, s=16, color=WRONG, zorder=4, label=f'incorrect loop: {len(wrong)}')
    axes.plot(*at[wrong].transpose(2, 1, 0), color=WRONG, linewidth=0.5)
    axes.scatter(*at[missed].T, s=26, color=BLACK, marker='x', linewidth=1, zorder=4, label=f'missed: {len(missed)}')
    axes.legend(frameon=False, loc='upper left', borderpad=0.2, handletextpad=0.1)


def draw_headings(axes, at, heading, loops, yaw):
    i, j = loops.T
    axes.plot(*at[loops].transpose(2, 1, 0), color='#6b7280', linewidth=0.7)
    for where, angle, color, name in ((at[j], heading[j], THEN, 'heading then'), (at[i], heading[j] + np.radians(yaw), NOW, 'heading now')):
        axes.quiver(*where.T, np.cos(angle), np.sin(angle), color=color, angles='xy', scale_units='xy', scale=0.4, width=0.009,
                    headwidth=3.6, headlength=4, headaxislength=3.6, zorder=3, label=name)
    axes.legend(frameon=False, loc='upper left', borderpad=0.2)


def draw_scale(axes, meters):
    (x, y), (width, height) = axes.viewLim.min, axes.viewLim.size
    right, low = x + 0.96 * width, y + 0.06 * height
    axes.plot([right - meters, right], [low, low], color=BLACK, linewidth=2)
    axes.text(right - meters / 2, low + 0.015 * height, f'{meters} m', ha='center', va='bottom')


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('loops', type=Path, help='output of `revisit loops --all --format jsonl`')
    parser.add_argument('-o', '--output', type=Path, default=Path('loops.png'))
    parser.add_argument('--frame', type=int, help='frame of a correct loop, for the close-up')
    parser.add_argument('--images', type=Path, help='folder of `revisit doctor SCAN --align none --images FOLDER` for this scan and its place')
    parser.add_argument('--zoom', type=float, default=30, help='height of the close-up [m] (default: %(default)s)')
    parser.add_argument('--exclusion', type=int, default=50, help='recent frames that are not loops (default: %(default)s)')
    parser.add_argument('--radius', type=float, default=5,
                        help='scans nearer than this to a place have a loop; accepted loops are correct within twice this [m] '
                             '(default: %(default)s)')
    o = parser.parse_args()

    scans, at, heading = read(o.loops)
    loops, wrong, missed = evaluate(scans, at, o.exclusion, o.radius)
    yaw = np.array([scans[i]['yaw_deg'] for i in loops[:, 0]])
    shown = [k for k, i in enumerate(loops[:, 0]) if scans[i]['frame'] == o.frame]
    if o.frame is not None and not shown:
        raise SystemExit(f'draw_loops: scan {o.frame} is not a correct loop')

    strips = ['now', 'then'] if shown and o.images else []
    figure, panels = plt.subplot_mosaic(
        [*([name, name] for name in strips), ['map', 'near' if shown else 'map']], figsize=(10, 3.7 + 1.15 * len(strips)),
        height_ratios=[1] * len(strips) + [3.1], width_ratios=(1.9, 1), layout='constrained')
    for axes in panels.values():
        axes.set(xticks=[], yticks=[])
    if strips:
        now, then = (scans[k]['frame'] for k in loops[shown[0]])
        degrees = yaw[shown[0]]
        draw_image(panels['now'], o.images / f'{now:06}_closed.png', 0, f'Query: range image of scan {now} (dark is near)', NOW)
        draw_image(panels['then'], o.images / f'{then:06}_closed.png', degrees,
                   f'Match: scan {then}, rotated by the estimated relative yaw of {degrees:.0f} degrees', THEN)
    draw_map(panels['map'], at, loops, yaw, wrong, missed)
    if shown:
        draw_headings(panels['near'], at, heading, loops, yaw)
    for name in ('map', 'near')[:1 + len(shown)]:
        panels[name].plot(*at.T, color=PATH, linewidth=1.5, zorder=1)
        panels[name].set_aspect('equal', adjustable='datalim')
    figure.canvas.draw()  # computes the sizes of the panels
    draw_scale(panels['map'], 100)
    if shown:
        box = panels['near'].get_window_extent()
        size = o.zoom * np.array([box.width / box.height, 1])
        low, high = at[loops[shown[0], 0]] - size / 2, at[loops[shown[0], 0]] + size / 2
        panels['near'].set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect='auto')
        draw_scale(panels['near'], 10)
        panels['map'].add_patch(plt.Rectangle(low, *size, fill=False, color=BLACK, zorder=5))
    figure.savefig(o.output, dpi=110)
    print(f'{len(loops) + len(wrong)} loops accepted, {len(loops)} correct, {len(missed)} missed')


if __name__ == '__main__':
    main()
