"""Attacks on maps on a private PostgreSQL server; sections of maps.py."""

import os
import select
import shutil
import signal
import socket
import struct
import subprocess
import threading
import time
from pathlib import Path

from harness import Fault, Skipped, digest, end_of, in_child, judge, message_of, run, start

FOUND = sorted(Path('/usr/lib/postgresql').glob('*/bin/postgres'))


class Server:
    def __init__(self, folder):
        self.folder, self.bin = folder, FOUND[-1].parent
        self.user = 'postgres' if os.geteuid() == 0 else None
        for parent in (folder, *folder.parents):
            if os.access(parent, os.W_OK) and parent.stat().st_uid == os.geteuid() and parent != Path('/'):
                os.chmod(parent, parent.stat().st_mode | 0o755)
        self.data = folder / 'server'
        shutil.rmtree(self.data, ignore_errors=True)
        self.data.mkdir(parents=True)
        if self.user:
            shutil.chown(self.data, self.user)
        self.command([self.bin / 'initdb', '--no-sync', '--no-locale', '-E', 'UTF8', '-A', 'trust', '-U', 'postgres', '-D', self.data])
        with socket.create_server(('127.0.0.1', 0)) as free:
            self.port = free.getsockname()[1]
        self.process = None
        self.start()

    def command(self, line, **more):
        return subprocess.run(list(map(str, line)), user=self.user, cwd='/', check=True, capture_output=True, **more)

    def start(self):
        for _ in range(300):
            if self.process is None or self.process.poll() is not None:
                self.process = subprocess.Popen(
                    [self.bin / 'postgres', '-D', self.data, '-k', self.data, '-p', str(self.port), '-c', 'shared_buffers=16MB',
                     '-c', 'recovery_init_sync_method=syncfs', '-c', 'listen_addresses=127.0.0.1'], user=self.user, cwd='/',
                    stdout=open(self.folder / 'server.log', 'a'), stderr=subprocess.STDOUT)
            if subprocess.run([self.bin / 'pg_isready', '-q', '-h', self.data, '-p', str(self.port)]).returncode == 0:
                return
            time.sleep(0.1)
        raise RuntimeError('the server does not start: ' + (self.folder / 'server.log').read_text()[-500:])

    def kill(self, how=signal.SIGKILL):
        self.process.send_signal(how)
        self.process.wait()

    def url(self, map_name, port=None, patience=15):
        return f'postgresql://postgres@127.0.0.1:{port or self.port}/postgres?map={map_name}&patience={patience}&sslmode=disable'

    def execute(self, sql):
        return self.command(['psql', '-h', self.data, '-p', self.port, '-U', 'postgres', '-XqtA', '-v', 'ON_ERROR_STOP=1', '-f', '-'],
                            input=sql.encode()).stdout.decode()


class Proxy:
    """Forwards data between clients and server, and breaks each connection at a random byte."""

    def __init__(self, to, seeded, most, until):
        self.to, self.random, self.most, self.until = to, seeded, most, until
        self.broken = 0
        self.listener = socket.create_server(('127.0.0.1', 0))
        self.port = self.listener.getsockname()[1]
        threading.Thread(target=self.accept, daemon=True).start()

    def accept(self):
        while True:
            try:
                client, _ = self.listener.accept()
            except OSError:
                return
            threading.Thread(target=self.serve, args=(client,), daemon=True).start()

    def serve(self, client):
        try:
            server = socket.create_connection(('127.0.0.1', self.to))
        except OSError:
            client.close()
            return
        left = int(self.most ** self.random.random() * 100) if self.broken < self.until else 1 << 60
        other = {client: server, server: client}
        try:
            while left > 0:
                for one in select.select([client, server], [], [])[0]:
                    part = one.recv(min(65536, left))
                    if not part:
                        return
                    left -= len(part)
                    other[one].sendall(part)
            self.broken += 1
            for one in other:  # abruptly, without a shutdown
                one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack('ii', self.random.randrange(2), 0))
        except OSError:
            pass
        finally:
            client.close()
            server.close()

    def close(self):
        self.listener.close()


def places_at(world, url, drive='00'):
    """Returns frame -> digest; frames must be unique and ids without gaps."""
    def read():
        with world.revisit.maps.MapStore.open(url) as store:
            return [(p.id, p.frame, digest(p)) for p in store.places() if p.drive == drive], store.warnings
    found, warnings = in_child(read)
    if warnings:
        raise Fault(f'damages: {warnings}')
    frames = [frame for _, frame, _ in found]
    if twice := sorted({frame for frame in frames if frames.count(frame) > 1}):
        raise Fault(f'twice: frames {twice}')
    return {frame: what for _, frame, what in found}


def whole(world):
    def read():
        with world.revisit.maps.MapStore.open(world.folder / 'whole.map') as store:
            return [(p.frame, digest(p)) for p in store.places()]
    return dict(in_child(read))


def hold(world, url, exact=True):
    found, wanted = places_at(world, url), whole(world)
    if (found != wanted) if exact else (found.keys() != wanted.keys()):
        raise Fault(f'not the places of a build in one go: lost {sorted(set(wanted) - set(found))}, other '
                    f'{sorted(f for f in found if wanted.get(f) != found[f])[:9]}')
    world.must_be_sound(url)


def with_server(work):
    def section_(world, section, times):
        if not FOUND:
            raise Skipped('no PostgreSQL is installed')
        server = Server(world.folder)
        try:
            work(world, section, times, server)
        finally:
            server.kill()
    section_.__doc__ = work.__doc__
    return section_


@with_server
def attack_server_kill(world, section, times, server):
    """Kills the server during a build, or requests an immediate shutdown."""
    for i, seeded in world.cases(section, times or 20):
        url = server.url(f'k{i}')
        with section.case(f'case {i}'):
            process = start(world.program, world.build_arguments(url))
            for _ in range(seeded.randrange(1, 4)):
                time.sleep(0.2 + seeded.random() * world.build_time)
                server.kill(seeded.choice((signal.SIGKILL, signal.SIGQUIT, signal.SIGINT)))
                server.start()
            out, err = end_of(process)
            result = judge(process.returncode, out, err, codes=(0, 1))
            if result.code and 'connection' not in result.err:
                raise Fault(result.err)
            if result.code:
                run(world.program, world.build_arguments(url), codes=(0,))
            hold(world, url)


@with_server
def attack_proxy(world, section, times, server):
    """Breaks connections at random bytes of a build, of loops and of a removal."""
    for i, seeded in world.cases(section, times or 60):
        url = server.url(f'p{i}')
        proxy = Proxy(server.port, seeded, 10 ** seeded.randrange(1, 5), until=seeded.randrange(1, 30))
        through = server.url(f'p{i}', proxy.port, patience=seeded.choice((0, 1, 5, 15)))
        loops = i % 4 == 3
        line = ['loops', world.drive, '--map', through, '--warmup', '16', '--threads', '1', '-q'] if loops else \
            world.build_arguments(through)
        with section.case(f'case {i}, {"loops" if loops else "build"}') as case:
            for _ in range(40):
                result = run(world.program, line, codes=(0, 1))
                case.refused = case.refused or result.code == 1
                if result.code and not any(word in result.err for word in ('connection', 'cannot be read')):
                    raise Fault(f'unclear: {result.err}')
                if result.code == 0 or loops:
                    break
            else:
                run(world.program, world.build_arguments(url), codes=(0,))
            if loops:
                if result.code == 0:
                    hold(world, url, exact=False)
                else:
                    try:
                        places_at(world, url)
                    except Fault as fault:
                        if 'no map' not in str(fault):
                            raise
            else:
                hold(world, url)
                result = run(world.program, ['map', 'remove', through, '--ids', '3,7-9'], codes=(0, 1))
                left = len(places_at(world, url))
                if left != (84 if result.code == 0 else left) or left not in (84, 88):
                    raise Fault(f'{left} places after a removal: {result.text}')
        proxy.close()
        print(f'{section.name}: case {i}: {proxy.broken} connections broken', flush=True)


class Checksum:
    """Checksum of rows as in pipeline/maps/src/checksum.h, so that untrusted rows are accepted."""

    def __init__(self):
        self.hash = 0xCBF29CE484222325

    def word(self, word):
        self.hash = (self.hash ^ word) * 0x100000001B3 & (1 << 64) - 1

    def number(self, value):
        self.word(value & 0xFFFFFFFF)
        self.word(value >> 32 & 0xFFFFFFFF)
        return self

    def bytes(self, text):
        self.number(len(text))
        for i in range(0, len(text), 4):
            self.word(int.from_bytes(text[i:i + 4], 'little'))
        return self

    @property
    def value(self):
        return struct.unpack('<q', struct.pack('<Q', self.hash))[0]


def hostile_tables(m):
    endless = 'WITH RECURSIVE c(x) AS (SELECT 1::bigint UNION ALL SELECT x+1 FROM c)'
    yield 'empty head', f'DELETE FROM {m}.map'
    yield 'no counts', f'DELETE FROM {m}.counts'
    for places in (-1, -2**63, 87, 89, 10**6, 10**12, 2**63 - 1):
        checksum = Checksum().number(places).number(0).value
        yield f'counts {places}', f'UPDATE {m}.counts SET places={places}, checksum={checksum}'
        yield f'counts {places}, wrong checksum', f'UPDATE {m}.counts SET places={places}, checksum=1'
    for i in (10**15, 2**63 - 1, -5):
        yield f'id {i}, counts lost', f'UPDATE {m}.place SET id={i} WHERE id=7; DELETE FROM {m}.counts'
        yield f'removed {i}', f'INSERT INTO {m}.removed VALUES ({i}, 7, {Checksum().number(i).number(7).value}); UPDATE {m}.map SET version=2'
    yield 'an endless view', f'DROP TABLE {m}.counts; CREATE VIEW {m}.counts AS {endless} SELECT 1 AS id, 88::bigint AS places, 0::bigint AS checksum'
    for column in ('drive', 'frame', 'time', 'pose', 'descriptor', 'feature', 'revision', 'checksum', 'call'):
        yield f'{column} NULL', f'ALTER TABLE {m}.place ALTER {column} DROP NOT NULL; UPDATE {m}.place SET {column}=NULL WHERE id=7'
        yield f'{column} text', (f"ALTER TABLE {m}.place ALTER {column} DROP NOT NULL; ALTER TABLE {m}.place ALTER {column} DROP DEFAULT; "
                                 f"ALTER TABLE {m}.place ALTER {column} TYPE text USING 'x'")
        yield f'no {column}', f'ALTER TABLE {m}.place DROP COLUMN {column}'
    for column in ('version', 'identity', 'bytes_per_number', 'revision', 'checksum'):
        yield f'head {column} NULL', f'ALTER TABLE {m}.map ALTER {column} DROP NOT NULL; UPDATE {m}.map SET {column}=NULL'
        yield f'head {column} text', f"ALTER TABLE {m}.map ALTER {column} TYPE text USING 'x'"
        yield f'head {column} huge', (f"ALTER TABLE {m}.map ALTER {column} TYPE numeric USING 99999999999999999999999" if column != 'identity'
                                      else f"UPDATE {m}.map SET identity=repeat('x', 10000000)")
    yield 'a trigger', (f"CREATE FUNCTION {m}.f() RETURNS trigger LANGUAGE plpgsql AS $$BEGIN RETURN NULL; END$$; CREATE TRIGGER t BEFORE INSERT "
                        f"ON {m}.place FOR EACH ROW EXECUTE FUNCTION {m}.f()")
    yield 'a trigger that raises', (f"CREATE FUNCTION {m}.f() RETURNS trigger LANGUAGE plpgsql AS $$BEGIN RAISE 'no'; END$$; CREATE TRIGGER t "
                                    f"BEFORE INSERT OR DELETE ON {m}.place FOR EACH ROW EXECUTE FUNCTION {m}.f()")
    yield 'own functions', (f"CREATE FUNCTION {m}.max(bigint) RETURNS bigint LANGUAGE sql AS 'SELECT -1::bigint'; "
                            f"CREATE FUNCTION {m}.has_schema_privilege(text,text) RETURNS bool LANGUAGE sql AS 'SELECT false'")
    yield 'version above', f'UPDATE {m}.map SET version=99'
    yield 'expects others', f"INSERT INTO {m}.expected VALUES ('00', -5, NULL), ('00', 9223372036854775807, NULL)"
    yield 'no place', f'DROP TABLE {m}.place'
    yield 'no rights', f'REVOKE ALL ON SCHEMA {m} FROM postgres'


@with_server
def attack_tables(world, section, times, server):
    """Uses tables of a map on a server with untrusted changes."""
    run(world.program, world.build_arguments(server.url('source')), codes=(0,))
    server.execute('CREATE DATABASE template TEMPLATE postgres')
    for i, name, sql in world.named(hostile_tables('source'), times):
        server.execute('DROP DATABASE IF EXISTS victim WITH (FORCE);\nCREATE DATABASE victim TEMPLATE template')
        try:
            server.command(['psql', '-h', server.data, '-p', server.port, '-U', 'postgres', '-XqtA', '-v', 'ON_ERROR_STOP=1', '-d', 'victim', '-f', '-'],
                           input=sql.encode())
        except subprocess.CalledProcessError as error:
            print(f'{section.name}: {name}: not made: {error.stderr.decode()[:200]}')
            continue
        url = server.url('source', patience=1).replace('/postgres?', '/victim?')
        with section.case(f'case {i}, {name}') as case:
            codes = []
            for line in (['info', url], ['check', url], ['places', url], ['query', url, world.first_scan, '-q'], ['remove', url, '--ids', '3']):
                codes.append(run(world.program, ['map', *line], timeout=20).code)
            codes.append(run(world.program, world.build_arguments(url), timeout=30).code)
            case.refused = all(codes)


@with_server
def attack_addresses(world, section, times, server):
    """Uses names of maps, drives and servers; servers that send nothing, or something else."""
    base = f'postgresql://postgres@127.0.0.1:{server.port}/postgres'
    urls = [base, f'{base}?', f'{base}?map=', f'{base}?map=a;drop', f'{base}?map=pg_x', f'{base}?map={"x" * 41}', f'{base}?map=public',
            f'{base}?map=information_schema', f"{base}?map=a'b", f'{base}?map=%61', f'{base}?map=a&map=b', f'{base}?patience=nan',
            f'{base}?patience=-1', f'{base}?patience=1e6', f'{base}?host=', f'{base}?x=y', 'postgresql://', 'postgresql:///', 'postgresql://[',
            'postgres://a:b@c:d@e', 'postgresql://%ff', 'postgresql://\xff', 'postgresql://127.0.0.1:99999/x', 'postgresql://127.0.0.1:1/x',
            f'{base}?application_name=%ff', f'{base}?options=-c%20statement_timeout%3D1', f'{base}?options=-c%20default_transaction_read_only%3Don',
            f'{base}?client_encoding=SJIS', f'postgresql://nobody@127.0.0.1:{server.port}/postgres', f'{base}?connect_timeout=x',
            f'postgresql://postgres@127.0.0.1:{server.port}/\x1b[2J', f'{base}?options=-c%20search_path%3Dx']

    def listener(answer):
        one = socket.create_server(('127.0.0.1', 0))

        def serve():
            kept = []
            while True:
                client, _ = one.accept()
                kept.append(client)
                if answer is not None:
                    client.recv(1000)
                    client.sendall(answer)
                    client.close()
        threading.Thread(target=serve, daemon=True).start()
        return one.getsockname()[1]

    for answer in (None, b'', b'HTTP/1.1 200 OK\r\n\r\n', b'N', b'S' * 1000, b'R\0\0\0\x08\0\0\0\0', b'E\x7f\xff\xff\xff', os.urandom(100000),
                   b'R\0\0\0\x08\0\0\0\0Z\0\0\0\x05I', b'E\0\0\0\x10SFATAL\0C\0M\0\0'):
        urls.append(f'postgresql://postgres@127.0.0.1:{listener(answer)}/x?map=m&patience=1')
    for url in urls:
        for command in ('info', 'build'):
            line = ['map', 'info', url] if command == 'info' else world.build_arguments(url)
            with section.case(f'{command} {url!r}') as case:
                result = run(world.program, line, timeout=30)
                case.refused = result.code != 0
                if '\x1b' in result.err:
                    raise Fault(f'commands the terminal: {result.err!r}')
    for i, drive in enumerate([b'\xff\xfe', b'', b'\n', b"'; DROP SCHEMA d0; --", b'x' * 100000, 'ä\u202e'.encode(), b'\\x00', b'$1']):
        url = server.url(f'd{i}')
        with section.case(f'drive {drive[:20]!r}') as case:
            for _ in range(2):
                result = run(world.program, [*world.build_arguments(url), '--drive', drive])
            case.refused = result.code != 0
            if result.code == 0:
                shown = drive.decode(errors='surrogateescape') or '00'  # '': the data set's name
                if len(places_at(world, url, shown)) != 88:
                    raise Fault('not all places')
    for name in ('a\0b', 'x\x01', '\ud800'):
        for kind, where in (('file', world.folder / f'nul{len(name)}.map'), ('server', server.url(f'nul{ord(name[1:2] or "x")}'))):
            with section.case(f'Python, drive {name!r} in a {kind}') as case:
                def add():
                    try:
                        recognizer = world.revisit.open_map(where, 'vlp16')
                        recognizer.add(world.description, drive=name, frame=1)
                        del recognizer
                    except UnicodeEncodeError:
                        return True
                    except TypeError:
                        return True
                    except Exception as error:
                        message_of(error)
                        return True
                    with world.revisit.maps.MapStore.open(where) as store:
                        if [p.drive for p in store.places()] != [name]:
                            raise Fault(f'another drive: {[p.drive for p in store.places()]}, {store.warnings}')
                    return False
                case.refused = in_child(add)
