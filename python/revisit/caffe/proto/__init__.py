"""Caffe's protobuf messages, as caffe.proto.caffe_pb2."""

from . import caffe_pb2
