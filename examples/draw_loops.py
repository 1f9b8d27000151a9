#!/usr/bin/env python3
"""Draws the loops of a drive: where they are, and one of them close to, with range images and headings.

  revisit loops drive --all --format jsonl -o loops.jsonl      # the drive needs poses
  draw_loops.py loops.jsonl -o loops.png
  revisit image drive/velodyne/000452.bin --align none --gamma 2 -o look       # scan 452; the same for its place
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
    """The scans with a position, these positions seen from above [m], and the direction of the path there [rad]."""
    scans = [scan for scan in map(json.loads, file.read_text().splitlines()) if 'position' in scan]
    if len(scans) < 2:
        raise SystemExit(f'draw_loops: {file} has no positions: the drive needs poses')
    at = np.array([(scan['position']['x'], scan['position']['z']) for scan in scans])  # x right, z ahead
    along = np.gradient(at, axis=0)
    return scans, at, np.arctan2(along[:, 1], along[:, 0])


def judge(scans, at, exclusion, radius):
    """Accepted pairs (scan, place): those within twice the radius, and the others. Scans that were missed."""
    index = {scan['frame']: i for i, scan in enumerate(scans)}
    pairs = np.array([(i, index[scan['match_frame']]) for i, scan in enumerate(scans) if scan.get('accepted')], int).reshape(-1, 2)
    right = np.hypot(*(at[pairs[:, 0]] - at[pairs[:, 1]]).T) < 2 * radius
    frames = np.array([scan['frame'] for scan in scans])
    missed = [i for i, scan in enumerate(scans) if not scan.get('accepted')
              and (np.hypot(*(at[frames < frames[i] - exclusion] - at[i]).T) < radius).any()]
    return pairs[right], pairs[~right], missed


def draw_image(axes, file, turn, title, colour):
    pixels = plt.imread(file)
    turned = np.roll(pixels, round(turn / 360 * pixels.shape[1]), axis=1)  # azimuth falls from left to right
    axes.imshow(turned, cmap='gray', aspect='auto', interpolation='antialiased')
    axes.set_title(title, color=colour, loc='left')
    axes.spines[:].set(color=colour, linewidth=1.5)


def draw_map(axes, at, loops, turn, wrong, missed):
    for name, low, high, colour in DIRECTIONS:
        chosen = loops[(low <= abs(turn)) & (abs(turn) < high), 0]
        axes.scatter(*at[chosen].T, s=16, color=colour, zorder=3, label=f'recognised, {name}: {len(chosen)}')
    axes.scatter(*at[wrong[:, 0]].T, s=16, color=WRONG, zorder=4, label=f'confused with another place: {len(wrong)}')
    axes.plot(*at[wrong].transpose(2, 1, 0), color=WRONG, linewidth=0.5)
    axes.scatter(*at[missed].T, s=26, color=BLACK, marker='x', linewidth=1, zorder=4, label=f'not recognised: {len(missed)}')
    axes.legend(frameon=False, loc='upper left', borderpad=0.2, handletextpad=0.1)


def draw_headings(axes, at, heading, loops, turn):
    """An arrow where the path led then, and one where the vehicle looks now by the turn that was found."""
    i, j = loops.T
    axes.plot(*at[loops].transpose(2, 1, 0), color='#6b7280', linewidth=0.7)
    for where, angle, colour, name in ((at[j], heading[j], THEN, 'heading then'), (at[i], heading[j] + np.radians(turn), NOW, 'heading now')):
        axes.quiver(*where.T, np.cos(angle), np.sin(angle), color=colour, angles='xy', scale_units='xy', scale=0.4, width=0.009,
                    headwidth=3.6, headlength=4, headaxislength=3.6, zorder=3, label=name)
    axes.legend(frameon=False, loc='upper left', borderpad=0.2)


def draw_scale(axes, metres):
    (x, y), (width, height) = axes.viewLim.min, axes.viewLim.size
    right, low = x + 0.96 * width, y + 0.06 * height
    axes.plot([right - metres, right], [low, low], color=BLACK, linewidth=2)
    axes.text(right - metres / 2, low + 0.015 * height, f'{metres} m', ha='center', va='bottom')


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('loops', type=Path, help='what `revisit loops --all --format jsonl` wrote')
    parser.add_argument('-o', '--output', type=Path, default=Path('loops.png'))
    parser.add_argument('--frame', type=int, help='a scan that was recognised, to be shown close to')
    parser.add_argument('--images', type=Path, help='PNG files of `revisit image --align none`, of this scan and its place')
    parser.add_argument('--zoom', type=float, default=30, help='height of what is close to [m]')
    parser.add_argument('--exclusion', type=int, default=50, help='frames just before, which are no loop')
    parser.add_argument('--radius', type=float, default=5, help='a place as near as this should be recognised [m]')
    o = parser.parse_args()

    scans, at, heading = read(o.loops)
    loops, wrong, missed = judge(scans, at, o.exclusion, o.radius)
    turn = np.array([scans[i]['yaw_deg'] for i in loops[:, 0]])  # [deg]
    shown = [k for k, i in enumerate(loops[:, 0]) if scans[i]['frame'] == o.frame]
    if o.frame is not None and not shown:
        raise SystemExit(f'draw_loops: scan {o.frame} was not recognised')

    strips = ['now', 'then'] if shown and o.images else []
    figure, panels = plt.subplot_mosaic(
        [*([name, name] for name in strips), ['map', 'near' if shown else 'map']], figsize=(10, 3.7 + 1.15 * len(strips)),
        height_ratios=[1] * len(strips) + [3.1], width_ratios=(1.9, 1), layout='constrained')
    for axes in panels.values():
        axes.set(xticks=[], yticks=[])
    if strips:
        now, then = (scans[k]['frame'] for k in loops[shown[0]])
        degrees = turn[shown[0]]
        draw_image(panels['now'], o.images / f'{now:06}_closed.png', 0, f'Scan {now} as a range image, dark is near', NOW)
        draw_image(panels['then'], o.images / f'{then:06}_closed.png', degrees,
                   f'The place it is recognised as: scan {then}, turned by the {degrees:.0f} degrees that were found', THEN)
    draw_map(panels['map'], at, loops, turn, wrong, missed)
    if shown:
        draw_headings(panels['near'], at, heading, loops, turn)
    for name in ('map', 'near')[:1 + len(shown)]:
        panels[name].plot(*at.T, color=PATH, linewidth=1.5, zorder=1)
        panels[name].set_aspect('equal', adjustable='datalim')
    figure.canvas.draw()  # the sizes of the panels are known from here
    draw_scale(panels['map'], 100)
    if shown:
        box = panels['near'].get_window_extent()
        size = o.zoom * np.array([box.width / box.height, 1])
        low, high = at[loops[shown[0], 0]] - size / 2, at[loops[shown[0], 0]] + size / 2
        panels['near'].set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect='auto')
        draw_scale(panels['near'], 10)
        panels['map'].add_patch(plt.Rectangle(low, *size, fill=False, color=BLACK, zorder=5))
    figure.savefig(o.output, dpi=110)
    print(f'{len(loops)} scans recognised, {len(wrong)} confused, {len(missed)} not recognised')


if __name__ == '__main__':
    main()
