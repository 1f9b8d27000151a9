"""The messages of Caffe's files: NetParameter, BlobProto, Datum, SolverParameter, LabelMap, ...

Built from the engine's schema in a separate descriptor pool, because the original Caffe may be imported into the same process.
"""

from google.protobuf import descriptor_pb2 as _descriptor_pb2
from google.protobuf import descriptor_pool as _descriptor_pool
from google.protobuf import message_factory as _message_factory
from google.protobuf import text_format as _text_format
from google.protobuf.message import DecodeError as _DecodeError
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper

from ... import proto as _proto
from ...errors import InputError as _InputError


def _renamed(message, old, new):
    for field in message.field:
        if field.type_name.startswith(old):
            field.type_name = new + field.type_name[len(old) :]
    for nested in message.nested_type:
        _renamed(nested, old, new)


# Class names of SSD. The engine's schema lacks these messages, because no network contains them.
_LABELS = """
message_type {
  name: "LabelMapItem"
  field { name: "name" number: 1 label: LABEL_OPTIONAL type: TYPE_STRING }
  field { name: "label" number: 2 label: LABEL_OPTIONAL type: TYPE_INT32 }
  field { name: "display_name" number: 3 label: LABEL_OPTIONAL type: TYPE_STRING }
}
message_type {
  name: "LabelMap"
  field { name: "item" number: 1 label: LABEL_REPEATED type: TYPE_MESSAGE type_name: ".caffe.LabelMapItem" }
}
"""


def _file():
    schema = _descriptor_pb2.FileDescriptorProto.FromString(_proto.schema())
    for message in schema.message_type:
        _renamed(message, f'.{schema.package}.', '.caffe.')
    schema.name, schema.package = 'caffe.proto', 'caffe'
    _text_format.Merge(_LABELS, schema)
    pool = _descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(schema.SerializeToString())
    return pool, pool.FindFileByName('caffe.proto')


def _class_of(descriptor):
    if hasattr(_message_factory, 'GetMessageClass'):
        return _message_factory.GetMessageClass(descriptor)
    return _message_factory.MessageFactory(_pool).GetPrototype(descriptor)  # protobuf before 4.22


_pool, DESCRIPTOR = _file()
for _name, _descriptor in DESCRIPTOR.message_types_by_name.items():
    globals()[_name] = _class_of(_descriptor)
for _name, _descriptor in DESCRIPTOR.enum_types_by_name.items():
    globals()[_name] = _enum_type_wrapper.EnumTypeWrapper(_descriptor)
    for _value in _descriptor.values:
        globals()[_value.name] = _value.number


def _tolerant(parse):
    """Returns a parser of binary nets that skips fields of forks whose numbers mean other fields here, as the engine does."""

    def parse_net(net, data):
        try:
            return parse(net, data)
        except _DecodeError:
            try:
                readable = _proto.readable_net(bytes(data))
            except _InputError:
                readable = None
        return parse(net, data if readable is None else readable)

    return parse_net


def _from_string(data):
    net = NetParameter()  # noqa: F821  defined in the loop above
    net.ParseFromString(data)
    return net


NetParameter.MergeFromString = _tolerant(NetParameter.MergeFromString)  # noqa: F821
NetParameter.ParseFromString = _tolerant(NetParameter.ParseFromString)  # noqa: F821
NetParameter.FromString = staticmethod(_from_string)  # noqa: F821
