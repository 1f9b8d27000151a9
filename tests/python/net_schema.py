"""The JSON schema of `revisit net inspect|profile --format json`, from tools/reports.proto and its comments.

  env PYTHONPATH=build/dev/python python3 tests/python/net_schema.py > docs/data/schemas/net.json
"""

import json
import subprocess
import tempfile
from pathlib import Path

from google.protobuf import descriptor_pb2

ROOT = Path(__file__).resolve().parents[2]
FILE = ROOT / 'docs' / 'data' / 'schemas' / 'net.json'
Field = descriptor_pb2.FieldDescriptorProto
TYPES = {Field.TYPE_STRING: 'string', Field.TYPE_DOUBLE: 'number', Field.TYPE_INT32: 'integer', Field.TYPE_BOOL: 'boolean'}
MESSAGE = 4  # numbers of these fields in FileDescriptorProto and DescriptorProto: paths of comments
FIELD = 2


def described():
    """Returns the file's descriptor with comments."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / 'reports.set'
        subprocess.run(['protoc', '--include_source_info', f'--descriptor_set_out={out}', f'-I{ROOT}/tools', 'reports.proto'], check=True)
        return descriptor_pb2.FileDescriptorSet.FromString(out.read_bytes()).file[0]


def schema():
    """Returns the schema: every field that is not optional is required, except for lists, which are left out when empty."""
    file = described()
    comments = {tuple(place.path): ' '.join(f'{place.leading_comments} {place.trailing_comments}'.split())
                for place in file.source_code_info.location}
    places = {message.name: i for i, message in enumerate(file.message_type)}
    definitions = {}

    def commented(path, value):
        return {'description': comments[path], **value} if comments.get(path) else value

    def define(name):
        i = places[name]
        definitions[name], properties, required = None, {}, []
        for j, field in enumerate(file.message_type[i].field):
            if field.type == Field.TYPE_MESSAGE:
                kind = field.type_name.rpartition('.')[2]
                if kind not in definitions:
                    define(kind)
                value = {'$ref': f'#/$defs/{kind}'}
            else:
                value = {'type': TYPES[field.type]}
            if field.label == Field.LABEL_REPEATED:
                value = {'type': 'array', 'items': value}
            elif not field.proto3_optional and field.type != Field.TYPE_MESSAGE:
                required.append(field.name)
            properties[field.name] = commented((MESSAGE, i, FIELD, j), value)
        definitions[name] = commented((MESSAGE, i), {'type': 'object', 'properties': properties, 'required': required,
                                                     'additionalProperties': False})

    define('NetReport')
    report = definitions.pop('NetReport')
    return {'$schema': 'https://json-schema.org/draft/2020-12/schema', 'title': 'revisit net inspect|profile --format json', **report,
            '$defs': dict(sorted(definitions.items()))}


def text():
    return json.dumps(schema(), indent=1) + '\n'


if __name__ == '__main__':
    print(text(), end='')
