#!/usr/bin/env python3
"""Writes the tables of README.md and docs/ from the files in docs/data/, whose rows are rows.py's.

A table in a page begins with a comment that names its rows and columns; rows of a drive are neighbors:

  <!-- table: real_drives.json drive=nclt,riverside columns=ap,recall_at_1 -->
  <!-- table: towns.json keyframes=1.0 routes=08,06 -->                         (keyframes=all: every frame)
  <!-- table: perturbed_scans.json drive=nclt,riverside columns=recall_at_1 -->   (a row per perturbation, the methods side by side)
  <!-- table: real_drives.json brief=kitti00,nclt -->                           (a row per drive: AP of each method, loops accepted)
  <!-- table: towns.json brief=08 keyframes=1.0 -->                             (a row per sensor, means over the towns)

The second form has the mean over towns of the drives townN-ROUTE-SENSOR (and how many), and the drive with the lowest average precision.
`columns` are those of COLUMNS below. NAMES has the names that pages show.
"""

import json
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT / 'docs/data'
MARK = re.compile(r'<!-- table: (\S+)((?: \w+=\S+)*) -->')
COLUMNS = {'ap': 'AP', 'recall_at_1': 'recall@1', 'recall_at_precision_1': 'recall at precision 1', 'with_place': 'queries with a place',
           'accepted_correct': 'accepted, correct', 'accepted_incorrect': 'accepted, incorrect', 'blocks': 'blocks', 'version': 'version'}
TOWN = re.compile(r'town\d+-(\d\d)-(.+)')
NAMES = {'rings': 'ring descriptor', 'rings, not registered': 'ring descriptor, without registration',
         'rings, local maps of 10 m': 'ring descriptor, local maps of 10 m',
         'rings without training, not registered': 'ring descriptor, untrained, without registration',
         'Scan Context, all candidates': 'Scan Context', 'Scan Context, 10 by ring keys': 'Scan Context, 10 candidates by ring key',
         'Scan Context, learnt as rings': 'Scan Context, trained alike', 'M2DP, learnt as rings': 'M2DP, trained alike'}
DRIVES = {'kitti00': 'KITTI 00, HDL-64E', 'nclt': 'NCLT, HDL-32E', 'riverside': 'MulRan Riverside, OS1-64', 'pcd_files': 'car with a VLP-16, pcd_files',
          'mid360_walk': 'walk with a Mid-360'}
SENSORS = {'vlp16': 'VLP-16', 'hdl64': 'HDL-64E', 'ouster-os1-64': 'OS1-64'}
# Columns of the short form: title, and the rows of which the best counts.
BRIEF = {'ring descriptor': ('rings',), 'Scan Context': ('Scan Context, all candidates',),
         'Scan Context, trained alike': ('Scan Context, learnt as rings',),
         "the paper's feature, best variant": tuple(f"the paper's feature, {case}" for case in ('aligned', 'both cases', 'not aligned')),
         'MapClosures': ('MapClosures, local maps of 20 m',)}


def rows_of(file):
    return json.loads((DATA / file).read_text())


def cell(value):
    return '-' if value is None else f'{value:.3f}' if isinstance(value, float) else str(value)


def with_interval(row):
    interval = row.get('ap_interval')  # 95 %
    kept = f' [{interval[0]:.2f}, {interval[1]:.2f}]' if interval else ' [not kept]' if 'judged' in row else ''
    return cell(row['ap']) + kept


def cell_of(row, column):
    if column == 'ap':
        return with_interval(row)
    if column == 'blocks':
        return f'{row["positive_blocks"]} of {row["blocks"]}' if 'blocks' in row else '-'
    return cell(row.get(column)) + (row.get('remark', '') if column == 'accepted_incorrect' else '')


def shown(name):
    return NAMES.get(name, name)


def markdown(heads, rows):
    """Lines of a table."""
    head, *lines = ['| ' + ' | '.join(row) + ' |' for row in (heads, *rows)]
    return [head, '|---' * len(heads) + '|', *lines]


def table(rows, drives, columns):
    drives = drives or dict.fromkeys(row['drive'] for row in rows)
    return markdown(['drive', 'method', *(COLUMNS[c] for c in columns)],
                    [[drive, shown(row['name']), *(cell_of(row, c) for c in columns)] for drive in drives for row in rows if row['drive'] == drive])


def table_of_towns(rows, keyframes, routes):
    found = {}
    for row in rows:
        drive = TOWN.fullmatch(row['drive'])
        if drive and row.get('keyframes') == keyframes and (route := drive[1]) in routes:
            found.setdefault((drive[2], row['name']), []).append((route, row))
    heads = ['sensor', 'method', *(f'AP, {route}' for route in routes), 'lowest AP', 'its interval', 'accepted, correct', 'accepted, incorrect']
    lines = []
    for (sensor, name), rows in found.items():
        of_route = [[row['ap'] for at, row in rows if at == route] for route in routes]
        means = [f'{cell(sum(aps) / len(aps))} ({len(aps)})' if aps else '-' for aps in of_route]
        rows = [row for _, row in rows]
        lowest = min(rows, key=lambda row: row['ap'])
        interval = lowest.get('ap_interval')
        accepted = ['-', '-']
        if 'accepted_correct' in rows[0]:
            accepted = [f'{sum(row["accepted_correct"] for row in rows)} of {sum(row["with_place"] for row in rows)}',
                        str(sum(row['accepted_incorrect'] for row in rows))]
        lines.append([sensor, shown(name), *means, cell(lowest['ap']), ' to '.join(map(cell, interval)) if interval else '-', *accepted])
    return markdown(heads, lines)


def table_of_perturbations(rows, drives, columns):
    rows = {(row['drive'], row['name'], row['perturbation']): row for row in rows}
    sides = [(drive, name) for drive in drives for name in dict.fromkeys(name for at, name, _ in rows if at == drive)]
    heads = [f'{drive}, {shown(name)}: {COLUMNS[column]}' for drive, name in sides for column in columns]
    return markdown(['perturbation', *heads],
                    [[at, *(cell(rows.get((*side, at), {}).get(column)) for side in sides for column in columns)]
                     for at in dict.fromkeys(at for _, _, at in rows)])


def best_mean(rows, names):
    """The highest mean AP of the methods in `names`, of those that ran on the most drives, and their number; (None, 0) if none ran."""
    found = [[row['ap'] for row in rows if row['name'] == name] for name in names]
    n = max(map(len, found))
    return (max(float(sum(aps) / n) for aps in found if len(aps) == n), n) if n else (None, 0)


def brief_table(first, groups):
    """groups: title of a row -> its rows."""
    lines = []
    for title, rows in groups.items():
        ours = [row for row in rows if row['name'] == 'rings']
        accepted = f'{sum(row["accepted_correct"] for row in ours)} of {sum(row["with_place"] for row in ours)}'
        if len(ours) == 1:
            rows = [row for row in rows if row['with_place'] == ours[0]['with_place']]  # of the same protocol
            found = ([row for row in rows if row['name'] in names] for names in BRIEF.values())
            values = [cell_of(ours[0], 'blocks'), *(with_interval(max(of, key=lambda row: row['ap'])) if of else '-' for of in found)]
        else:
            values = [cell(mean) + (f' ({n})' if 0 < n < len(ours) else '') for mean, n in (best_mean(rows, names) for names in BRIEF.values())]
        incorrect = str(sum(row['accepted_incorrect'] for row in ours)) + ours[0].get('remark', '')
        lines.append([title, *values, accepted, incorrect])
    return markdown([first, *['blocks'][:len(lines[0]) - len(BRIEF) - 3], *BRIEF, 'loops accepted', 'incorrect loops'], lines)


def brief_of(rows, wanted):
    chosen = wanted['brief'].split(',')
    if 'keyframes' not in wanted:
        return brief_table('AP, real drives', {DRIVES[drive]: [row for row in rows if row['drive'] == drive] for drive in chosen})
    groups = {}
    for row in rows:
        drive = TOWN.fullmatch(row['drive'])
        if drive and row.get('keyframes') == float(wanted['keyframes']) and drive[1] in chosen:
            groups.setdefault(drive[2], []).append(row)
    titled = {}
    for sensor, group in groups.items():
        n = len({row['drive'] for row in group if row['name'] == 'rings'})
        titled[f'route {", ".join(chosen)}, {SENSORS[sensor]}, {n} towns'] = group
    return brief_table('AP, simulated drives', titled)


def wanted_table(file, wanted):
    rows = rows_of(file)
    if 'brief' in wanted:
        return brief_of(rows, wanted)
    drives, routes, columns = (wanted[key].split(',') if key in wanted else None for key in ('drive', 'routes', 'columns'))
    if routes:
        return table_of_towns(rows, None if wanted['keyframes'] == 'all' else float(wanted['keyframes']), routes)
    return (table_of_perturbations if 'perturbation' in rows[0] else table)(rows, drives, columns)


def tables_in(lines):
    """(index behind the mark, index behind the table, what the table should be) of a page's lines."""
    for i, line in enumerate(lines):
        mark = MARK.fullmatch(line)
        if not mark:
            continue
        wanted = dict(word.split('=') for word in mark[2].split())
        end = i + 1
        while end < len(lines) and lines[end].startswith('|'):
            end += 1
        yield i + 1, end, wanted_table(mark[1], wanted)


def write(page):
    lines = page.read_text().splitlines()
    for begin, end, right in reversed(list(tables_in(lines))):
        lines[begin:end] = right
    page.write_text('\n'.join(lines) + '\n')


if __name__ == '__main__':
    for page in (ROOT / 'README.md', *sorted((ROOT / 'docs').rglob('*.md'))):
        if MARK.search(page.read_text()):
            write(page)
