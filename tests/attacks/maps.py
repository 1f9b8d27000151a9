#!/usr/bin/env python3
"""Attacks maps: files and the server. Prints every fault with its seed; exit code 1 on one.

  tests/attacks/maps.py                                all sections
  tests/attacks/maps.py wal disk --times 2000          two of them, each with so many cases
  tests/attacks/maps.py server_kill --times 300        kill -9 of a server at random moments of a build
  tests/attacks/maps.py wal --seed 7 --only 1234       one case again
  tests/attacks/maps.py --build build/asan             another build's program and Python package

A fault is: death by a signal, a hang, an internal message (std::, an assertion), an exception of a type that
revisit does not raise on purpose, or places that are wrong, duplicated or lost without a message.
"""

import contextlib
import os
import resource
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import server
from harness import Fault, damaged, digest, fresh, in_child, message_of, parser_for, run, seeded, start, work_through

ROOT = Path(__file__).resolve().parents[2]
STRETCH = '16'  # places for training the basis


class World:
    def __init__(self, arguments, folder):
        self.seed, self.only, self.folder = arguments.seed, arguments.only, folder
        self.program = arguments.build / 'tools/revisit'
        sys.path.insert(0, str(arguments.build / 'python'))
        import revisit
        self.revisit = revisit
        self.drive = folder / 'town'
        # Scans of one machine must be equal in every run: the seed is the town's, not the attack's.
        run(self.program, ['simulate', '--length', '300', '--every', '6', '--sensor', 'vlp16', '-o', self.drive, '-q'])
        self.first_scan = sorted((self.drive / 'sequences/00/velodyne').iterdir())[0]
        whole = folder / 'whole.map'
        begin = time.monotonic()
        run(self.program, self.build_arguments(whole))
        self.build_time = time.monotonic() - begin
        self.built = self.places_of(whole)  # expected from every build, despite interruptions
        # The attacked map has all features: values, removed places.
        self.file = folder / 'town.map'
        shutil.copy(whole, self.file)
        run(self.program, ['map', 'remove', self.file, '--ids', '5,40'])
        recognizer = revisit.open_map(self.file, 'vlp16')
        recognizer.calibrate(0.25)
        self.description = recognizer.describe(revisit.datasets.read_scan(self.first_scan))
        del recognizer
        self.places, self.bytes = self.places_of(self.file), self.file.read_bytes()
        assert len(self.built) == len(self.places) + 2 > 80

    def build_arguments(self, file, threads='1'):
        return ['map', 'build', self.drive, '--map', file, '--warmup', STRETCH, '--threads', threads, '-q']

    def places_of(self, file):
        """Returns id -> digest; fails on any fault."""
        def read():
            with self.revisit.maps.MapStore.open(file) as store:
                found = {place.id: digest(place) for place in store.places()}
                return found, store.warnings
        found, warnings = in_child(read)
        if warnings:
            raise Fault(f'damages: {warnings}')
        if len(set(found.values())) != len(found):
            raise Fault('places are there twice')
        return {int(i): d for i, d in found.items()}

    def cases(self, section, times):
        for i in range(times) if self.only is None else [self.only]:
            yield i, seeded(self.seed, section.name, i)

    def named(self, cases, times):
        """Yields number, name and action of the first cases of a list."""
        for i, (name, what) in enumerate(list(cases)[:times or None]):
            if self.only in (None, i):
                yield i, name, what

    def copy_for(self, section):
        file = fresh(self.folder / section.name) / 'm.map'
        file.write_bytes(self.bytes)
        return file

    def must_be_sound(self, file):
        if wrong := in_child(lambda: self.revisit.maps.check_map(file)):
            raise Fault(f'check: {wrong}')

    def build_to_the_end(self, file):
        run(self.program, self.build_arguments(file), codes=(0,))
        found = self.places_of(file)
        if found != self.built:
            lost = sorted(set(self.built) - set(found))
            other = sorted(i for i in found if self.built.get(i) != found[i])
            raise Fault(f'not the places of a build in one go: lost {lost[:9]}, other {other[:9]}')


def examine(world, file, may_lack_the_end=False):
    """Opens, reads, checks, queries, adds and removes, in a child. Returns whether the file was rejected."""
    revisit = world.revisit
    maps = revisit.maps

    def read():
        with maps.MapStore.open(file) as store:
            found = [(place.id, digest(place)) for place in store.places()]
            for name in ('basis', 'threshold', 'calibration'):
                try:
                    store.value(name)
                except Exception as error:
                    message_of(error)
            return found, store.warnings, len(store), store.removed()

    def hold(found, warnings, size, removed, added=()):
        known = {**world.places, **dict(added)}
        ids = [i for i, _ in found]
        if ids != sorted(set(ids)):
            raise Fault(f'ids do not ascend: {ids}')
        for i, what in found:
            if known.get(i) != what:
                raise Fault(f'place {i} is another than was written')
        missing = sorted(set(known) - set(ids))
        if missing and not warnings and not (may_lack_the_end and missing == list(range(missing[0], max(known) + 1))):
            raise Fault(f'lost without a word: {missing}')
        if not warnings and not missing and size != len(known):
            raise Fault(f'{size} places, {len(known)} are there')

    def work():
        refused = False
        before = None
        try:
            before = read()
            hold(*before)
        except Fault:
            raise
        except Exception as error:
            message_of(error)
            refused = True
        try:
            wrong = maps.check_map(file)
            if not wrong and refused:
                raise Fault('refused, but sound for check')
            if before and before[1] and not wrong:
                raise Fault(f'sound for check, but not read: {before[1]}')
        except Fault:
            raise
        except Exception as error:
            message_of(error)
        added = []
        try:
            recognizer = revisit.open_map(file, 'vlp16')
            recognizer.query(world.description)
            try:
                recognizer.add(world.description, drive='new', frame=123456)
                added.append(123456)
            except Exception as error:
                message_of(error)
            del recognizer
        except Exception as error:
            message_of(error)
        if before is None:
            return refused
        try:
            with maps.MapStore.open(file) as store:
                places = store.places()
                new = [place for place in places if place.drive == 'new']
                old = [(place.id, digest(place)) for place in places if place.drive != 'new']
                if len(new) != len(added) and not store.warnings:
                    raise Fault(f'{len(new)} places of {len(added)} added')
                if lost := set(before[0]) - set(old):
                    raise Fault(f'adding lost {sorted(lost)}')
            last = max((place.id for place in places), default=0)
            if last:
                with maps.MapStore.open(file, write=True) as store:
                    store.remove([last])
        except Fault:
            raise
        except Exception as error:
            message_of(error)
        return refused

    return in_child(work)


def killed_copy(world, folder):
    """Returns FILE -> bytes of a map with log and shared memory, as left by a killed writer."""
    file = fresh(folder) / 'm.map'

    def write():
        recognizer = world.revisit.open_map(file, 'vlp16', first_stretch=int(STRETCH))
        for place in range(len(world.built)):
            recognizer.add(world.description, drive='00', frame=place)
        os.kill(os.getpid(), signal.SIGKILL)
    try:
        in_child(write)
    except Fault as fault:
        assert 'signal 9' in str(fault), fault
    return {end: Path(f'{file}{end}').read_bytes() for end in ('', '-wal', '-shm')}


def attack_wal(world, section, times):
    """Corrupts or truncates bytes of the log or the shared memory, or removes the file."""
    files = killed_copy(world, world.folder / 'killed')
    before = world.places
    for end, what in files.items():
        (world.folder / f'killed/k.map{end}').write_bytes(what)
    world.places = world.places_of(world.folder / 'killed/k.map')
    for i, random in world.cases(section, times or 1000):
        file = fresh(world.folder / section.name) / 'm.map'
        victim = random.choice(('-wal', '-wal', '-shm'))
        how = random.choice(('damage', 'damage', 'damage', 'remove', 'noise'))
        for end, what in files.items():
            data = what
            if end == victim:
                data = {'damage': lambda: damaged(random, what),
                        'remove': lambda: None,
                        'noise': lambda: random.randbytes(len(what))}[how]()
            if data is not None:
                Path(f'{file}{end}').write_bytes(data)
        with section.case(f'case {i}: {victim} {how}') as case:
            case.refused = examine(world, file, may_lack_the_end=victim == '-wal')
    world.places = before


def attack_stale(world, section, times):
    """Puts another map's log, or an old log of this map, beside the map."""
    files = killed_copy(world, world.folder / 'killed')
    for name, main in (('another map', world.bytes), ('an empty file', b''), ('text', b'x' * 9000)):
        for shm in (True, False):
            file = fresh(world.folder / section.name) / 'm.map'
            file.write_bytes(main)
            Path(f'{file}-wal').write_bytes(files['-wal'])
            if shm:
                Path(f'{file}-shm').write_bytes(files['-shm'])
            with section.case(f'{name}, shm {shm}') as case:
                codes = []
                for command in ('info', 'check', 'places'):
                    codes.append(run(world.program, ['map', command, file]).code)
                codes.append(run(world.program, ['map', 'remove', file, '--ids', '3']).code)
                case.refused = all(codes)


def attack_beside(world, section, times):
    """Puts pipes, folders, links and devices at the paths of SQLite's files and of the lock."""
    precious = world.folder / 'precious'

    kinds = {'pipe': os.mkfifo, 'folder': os.mkdir, 'link': lambda path: os.symlink(precious, path),
             'zeros': lambda path: os.symlink('/dev/zero', path), 'full': lambda path: os.symlink('/dev/full', path),
             'dangling': lambda path: os.symlink(world.folder / 'nowhere', path),
             'itself': lambda path: os.symlink(path, path)}
    for end in ('-wal', '-shm', '-journal', '-writer', ''):
        for kind, make in kinds.items():
            for command in (['info'], ['check'], ['remove', '--ids', '3'], ['build']):
                folder = fresh(world.folder / section.name)
                file = folder / 'm.map'
                if end:
                    file.write_bytes(world.bytes)
                make(f'{file}{end}')
                precious.write_bytes(b'precious')
                line = ['map', command[0], file, *command[1:]] if command != ['build'] else world.build_arguments(file)
                with section.case(f'FILE{end} is a {kind}: {command[0]}') as case:
                    result = run(world.program, line, timeout=20)
                    case.refused = result.code != 0
                    if not precious.exists() or precious.read_bytes() != b'precious':
                        if (end, kind) != ('', 'link'):
                            raise Fault('a file of the user was changed')
                    if end and result.code == 0 and command == ['info'] and 'places' not in result.out:
                        raise Fault(result.text)


def hostile_schemas():
    deep = 'SELECT 1 AS id' + ' UNION ALL SELECT 1' * 400
    endless = 'WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x+1 FROM c) SELECT x AS id'
    head = ', 1 AS places, 1 AS "values", 0 AS checksum FROM c'
    yield 'a view for counts', f'DROP TABLE counts; CREATE VIEW counts AS {endless}{head}'
    yield 'a view for map', ('DROP TABLE map; CREATE VIEW map AS WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x+1 '
                             'FROM c) SELECT x AS id, x AS identity, 4 AS bytes_per_number, 0 AS revision, 0 AS checksum FROM c')
    yield 'a view for place', f'DROP TABLE place; CREATE VIEW place AS {deep}'
    yield 'a view of itself', 'DROP TABLE value; CREATE VIEW value AS SELECT * FROM value'
    yield 'a trigger', 'CREATE TRIGGER t AFTER INSERT ON place BEGIN DELETE FROM place; END'
    yield 'a trigger that raises', "CREATE TRIGGER t BEFORE INSERT ON place BEGIN SELECT RAISE(ABORT, 'no'); END"
    yield 'an index', 'CREATE INDEX i ON place(frame)'
    yield 'an index of an expression', 'CREATE INDEX i ON place(abs(frame))'
    yield 'a column more', 'ALTER TABLE place ADD COLUMN more TEXT'
    yield 'a generated column', ('DROP TABLE counts; CREATE TABLE counts (id INTEGER PRIMARY KEY, places INTEGER AS '
                                 '(randomblob(1000000000)), "values" INTEGER, checksum INTEGER)')
    yield 'a virtual table', "CREATE VIRTUAL TABLE v USING fts5(x)"
    yield 'another type', 'DROP TABLE place; CREATE TABLE place (id TEXT, drive TEXT)'
    yield 'without rowid', 'DROP TABLE value; CREATE TABLE value (id INTEGER PRIMARY KEY, name TEXT, bytes BLOB, checksum INTEGER) WITHOUT ROWID'
    yield 'the schema rewritten', "PRAGMA writable_schema=1; UPDATE sqlite_schema SET rootpage=rootpage%3+2"
    yield 'one root for all', "PRAGMA writable_schema=1; UPDATE sqlite_schema SET rootpage=2"
    yield 'the root far away', "PRAGMA writable_schema=1; UPDATE sqlite_schema SET rootpage=2000000000 WHERE name='place'"
    yield 'a root below zero', "PRAGMA writable_schema=1; UPDATE sqlite_schema SET rootpage=-5 WHERE name='place'"
    yield 'no sql', "PRAGMA writable_schema=1; UPDATE sqlite_schema SET sql=NULL WHERE name='place'"
    yield 'long sql', "PRAGMA writable_schema=1; UPDATE sqlite_schema SET sql=sql||printf('%.*c',5000000,'-') WHERE name='place'"
    yield 'two of a name', "PRAGMA writable_schema=1; INSERT INTO sqlite_schema SELECT * FROM sqlite_schema WHERE name='place'"
    yield 'UTF-16', None
    yield 'another version', 'PRAGMA user_version=1'
    yield 'a version below', 'PRAGMA user_version=-3'
    yield 'a version above', 'PRAGMA user_version=99'
    yield 'a schema format above', 'PRAGMA writable_schema=1; PRAGMA schema_version=9999999'
    yield 'all empty', 'DELETE FROM map; DELETE FROM map_copy; DELETE FROM counts; DELETE FROM value; DELETE FROM place'


def attack_schema(world, section, times):
    """Uses tables of other programs or untrusted ones, and columns of other types."""
    for i, name, sql in world.named(hostile_schemas(), times):
        file = world.copy_for(section)
        try:
            with contextlib.closing(sqlite3.connect(file)) as database:
                if sql is None:
                    file.unlink()
                    database.close()
                    database = sqlite3.connect(file)
                    database.executescript(f"PRAGMA encoding='UTF-16le'; PRAGMA application_id={0x52565354}; "
                                           'PRAGMA user_version=1; CREATE TABLE map (id INTEGER PRIMARY KEY)')
                else:
                    database.executescript(sql)
        except sqlite3.Error as error:
            print(f'{section.name}: {name}: not made: {error}')
            continue
        with section.case(f'case {i}, {name}') as case:
            case.refused = examine(world, file)
            case.refused = drive_all(world, file) and case.refused


def drive_all(world, file):
    """Runs every command on a map; returns whether all rejected it."""
    copy, codes = Path(f'{file}.out'), []
    for arguments in (['info', file], ['check', file], ['places', file], ['query', file, world.first_scan, '-q'],
                      ['remove', file, '--ids', '3', '--dry-run'], ['forget', file, '--older', '1'],
                      ['merge', file, file, '-o', copy], ['remove', file, '--ids', '3']):
        if arguments[0] == 'merge':
            copy.unlink(missing_ok=True)
        codes.append(run(world.program, ['map', *arguments], timeout=30).code)
    codes.append(run(world.program, world.build_arguments(file), timeout=60).code)
    return all(codes)


def attack_disk(world, section, times):
    """Applies file size limits and small file systems of random sizes."""
    whole = world.file.stat().st_size
    for i, random in world.cases(section, times or 80):
        folder = fresh(world.folder / section.name)
        file = folder / 'm.map'
        limit = random.randrange(0, int(1.2 * whole) if random.random() < 0.5 else 20000)
        mounted = os.geteuid() == 0 and i % 2 == 0 and subprocess.run(
            ['mount', '-t', 'tmpfs', '-o', f'size={max(4096, limit)}', 'attack', folder], capture_output=True).returncode == 0
        try:
            with section.case(f'case {i}: {limit} bytes, {"tmpfs" if mounted else "RLIMIT_FSIZE"}') as case:
                limits = [] if mounted else [(resource.RLIMIT_FSIZE, limit)]
                result = run(world.program, world.build_arguments(file), limits=limits, codes=(0, 1))
                case.refused = result.code != 0
                if result.code and 'm.map' not in result.err:
                    raise Fault(f'the error names no file: {result.err}')
                if file.exists() and file.stat().st_size:
                    if result.code == 0 or not mounted:
                        world.must_be_sound(file)
                        world.places_of(file)
                if i % 3 == 0:
                    run(world.program, ['map', 'merge', world.file, world.file, '-o', folder / 'x'], limits=limits)
                if mounted:  # free space again
                    (folder / 'x').unlink(missing_ok=True)
                    subprocess.run(['mount', '-o', 'remount,size=100m', folder], check=True, capture_output=True)
                world.build_to_the_end(file)
        finally:
            if mounted:
                subprocess.run(['umount', folder], check=False)


def attack_memory(world, section, times):
    """Applies ulimit -v, from too little for anything to enough."""
    for i, random in world.cases(section, times or 150):
        file = world.copy_for(section)
        memory = int(30e6 * 100 ** random.random())
        command = random.choice((['map', 'info', file], ['map', 'check', file], ['map', 'places', file],
                                 ['map', 'query', file, world.first_scan, '-q'], ['map', 'remove', file, '--ids', '9'],
                                 ['map', 'merge', file, file, '-o', f'{file}2'], ['loops', world.drive, '--map', file, '-q'],
                                 world.build_arguments(f'{file}3')))
        with section.case(f'case {i}: {memory} bytes, {command[0]} {command[1]}') as case:
            result = run(world.program, command, limits=[(resource.RLIMIT_AS, memory)], codes=(0, 1, 2, 3, 6, 127))
            if result.code == 127 and 'shared librar' not in result.err:
                raise Fault(f'127: {result.err}')
            case.refused = result.code != 0
            if command[1] != 'remove' and command[0] != 'loops':
                world.places_of(file)
            world.must_be_sound(file)
            new = Path(f'{file}3')
            if new.exists() and new.stat().st_size:
                world.build_to_the_end(new)


def attack_names(world, section, times):
    """Uses names of maps and drives that are not UTF-8, contain terminal escape sequences, are too long, or look like something else."""
    folder = fresh(world.folder / section.name)
    names = [b'\xff\xfe\x80.map', b'a\nb.map', b'\x1b[2J.map', b'x' * 250, b'x' * 255, b'x' * 5000, b'file:x?mode=memory',
             b':memory:', b'', b' ', b'-', b'--', b'%s%n%s', b'a?b#c%25.map', b'postgresql:/x', b'x/../../y.map', b'no/where.map',
             'ä\u202eb.map'.encode(), b'.', b'..', b'/', b'/dev/null', b'/dev/full', b'/dev/zero', b'/proc/self/mem',
             b'/proc/self/fd/0', b'/dev/stdin', b"';DROP TABLE place;--", b'm.map/', b'm.map-wal', b'm.map-writer']
    (folder / 'm.map').write_bytes(world.bytes)
    for name in names:
        for command in ('build', 'info', 'check', 'query', 'remove', 'merge', 'loops'):
            line = {'build': world.build_arguments(name), 'info': ['map', 'info', name], 'check': ['map', 'check', name],
                    'query': ['map', 'query', name, world.first_scan, '-q'],
                    'remove': ['map', 'remove', name, '--ids', '1'],
                    'merge': ['map', 'merge', folder / 'm.map', folder / 'm.map', '-o', name],
                    'loops': ['loops', world.drive, '--map', name, '-q']}[command]
            with section.case(f'{name[:20]!r}: {command}') as case:
                result = run(world.program, line, cwd=folder)
                case.refused = result.code != 0
                if '\x1b' in result.err:
                    raise Fault(f'commands the terminal: {result.err!r}')
            (folder / 'm.map').write_bytes(world.bytes)
    drives = [b'\xff\xfe', b'', b'\n', b'\x1b[2J', b'x' * 100000, b"'; DROP TABLE place; --", b'a,"b"', 'ä'.encode(), b'%s%n']
    for drive in drives:
        file = folder / 'drive.map'
        file.unlink(missing_ok=True)
        with section.case(f'drive {drive[:20]!r}') as case:
            for _ in range(2):
                result = run(world.program, [*world.build_arguments(file), '--drive', drive])
            case.refused = result.code != 0
            if result.code == 0:
                process = start(world.program, ['map', 'places', file])
                out, _ = process.communicate()
                if out.count(b',') < 80 or (drive and drive.strip(b'"\n')[:5].replace(b'"', b'""') not in out):
                    raise Fault(f'places has another drive: {out[:200]!r}')
                if in_child(lambda: world.revisit.maps.check_map(file)):
                    raise Fault('damaged')


SECTIONS = {name.removeprefix('attack_'): work for name, work in [*globals().items(), *vars(server).items()]
            if name.startswith('attack_')}


def main():
    parser = parser_for(SECTIONS, __doc__, 'sections:\n' + '\n'.join(f'  {name:<12} {work.__doc__}' for name, work in SECTIONS.items()))
    parser.add_argument('--times', type=int, help='cases of each section (default: its own)')
    parser.add_argument('--only', type=int, metavar='CASE', help='this case of the sections only')
    parser.add_argument('--build', type=Path, default=ROOT / 'build/dev', help='default: build/dev')
    parser.add_argument('--folder', type=Path, help='keep what is made in this folder')
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        world = World(arguments, fresh(arguments.folder or temporary))
        return work_through(SECTIONS, parser, arguments, lambda work, section: work(world, section, arguments.times))


if __name__ == '__main__':
    sys.exit(main())
