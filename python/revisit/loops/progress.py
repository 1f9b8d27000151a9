"""Progress, on a terminal only."""

import sys
import time

EVERY = 0.2
"""[s]"""


def minutes(seconds) -> str:
    return f'{int(seconds) // 60}:{int(seconds) % 60:02}'


def scans_told(scans, count, shown=None):
    """The same scans. On a terminal a line says how many were taken, how fast, and how long it will go on."""
    if not ((sys.stderr is not None and sys.stderr.isatty()) if shown is None else shown):
        yield from scans
        return
    start = told = time.monotonic()
    done = 0
    try:
        for scan in scans:
            yield scan
            done += 1
            now = time.monotonic()
            if now - told < EVERY:
                continue
            told, rate = now, done / (now - start)
            of = f'/{count} scans, {rate:.1f} a second, {minutes((count - done) / rate)} to go' if count \
                else f' scans, {rate:.1f} a second'
            print(f'\rrecognising {done}{of}\033[K', end='', file=sys.stderr, flush=True)
    finally:
        print('\r\033[K', end='', file=sys.stderr, flush=True)
