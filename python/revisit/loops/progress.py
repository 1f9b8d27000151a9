"""Progress line on a terminal."""

import sys
import time

EVERY = 0.2
"""[s]"""


def minutes(seconds) -> str:
    return f'{int(seconds) // 60}:{int(seconds) % 60:02}'


def with_progress(scans, count, shown=None):
    """Yields the scans. Shows their number, rate and remaining time on a terminal (shown: None), always or never."""
    if not ((sys.stderr is not None and sys.stderr.isatty()) if shown is None else shown):
        yield from scans
        return
    start = printed = time.monotonic()
    done = 0
    try:
        for scan in scans:
            yield scan
            done += 1
            now = time.monotonic()
            if now - printed < EVERY:
                continue
            printed, rate = now, done / (now - start)
            of = f'/{count} scans, {rate:.1f} scans/s, {minutes((count - done) / rate)} left' if count \
                else f' scans, {rate:.1f} scans/s'
            print(f'\rrecognizing {done}{of}\033[K', end='', file=sys.stderr, flush=True)
    finally:
        print('\r\033[K', end='', file=sys.stderr, flush=True)
