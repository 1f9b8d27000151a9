"""The messages of Caffe's files, made from the project's own schema when this is imported.

`messages` are the messages as they are. In `raw_messages` the numbers of a BlobProto are bytes: packed floats are bytes
on the wire, so an array of a hundred million numbers is read without making a Python object of each.
"""

import subprocess
import tempfile
from pathlib import Path
from types import SimpleNamespace

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from .errors import ConversionError

SOURCE = Path(__file__).resolve().parents[2] / 'proto' / 'caffe_schema.proto'
NUMBERS = ('data', 'diff', 'double_data', 'double_diff')


def _descriptors():
    """The compiled schema: that of the Python package `revisit`, or from the sources."""
    try:
        import revisit.proto
    except ImportError:
        return _compiled_sources()
    compiled = descriptor_pb2.FileDescriptorSet()
    compiled.file.add().ParseFromString(revisit.proto.schema())
    return compiled


def _compiled_sources():
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / 'schema.desc'
        try:
            subprocess.run(['protoc', f'--proto_path={SOURCE.parent}', f'--descriptor_set_out={out}', str(SOURCE)],
                           check=True, capture_output=True, text=True)
        except FileNotFoundError:
            raise ConversionError('the compiler of schemas, protoc, is missing: apt install protobuf-compiler') from None
        except subprocess.CalledProcessError as error:
            raise ConversionError(f'protoc does not take {SOURCE}: {error.stderr.strip()}') from None
        return descriptor_pb2.FileDescriptorSet.FromString(out.read_bytes())


def _classes(descriptors):
    """The classes of all messages of a compiled schema, by name."""
    pool = descriptor_pool.DescriptorPool()
    for file in descriptors.file:
        pool.Add(file)
    package = descriptors.file[0].package
    return SimpleNamespace(**{
        message.name: message_factory.GetMessageClass(pool.FindMessageTypeByName(f'{package}.{message.name}'))
        for message in descriptors.file[0].message_type})


def _with_raw_numbers(descriptors):
    """The same schema, with the numbers of a BlobProto as bytes."""
    raw = descriptor_pb2.FileDescriptorSet()
    raw.CopyFrom(descriptors)
    blob = next(message for message in raw.file[0].message_type if message.name == 'BlobProto')
    for field in blob.field:
        if field.name in NUMBERS:
            field.type = descriptor_pb2.FieldDescriptorProto.TYPE_BYTES
            field.label = descriptor_pb2.FieldDescriptorProto.LABEL_OPTIONAL
            field.ClearField('options')
    return raw


_compiled = _descriptors()
messages = _classes(_compiled)
raw_messages = _classes(_with_raw_numbers(_compiled))
