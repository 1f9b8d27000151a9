"""Caffe's files: network descriptions, weights, mean images."""

from revisit._core.proto import (
    Limits, NetFile, WeightsFile, parse_net, parse_net_binary, read_binaryproto, read_net,
    read_net_binary, schema)

__all__ = [
    'Limits', 'NetFile', 'WeightsFile', 'parse_net', 'parse_net_binary', 'read_binaryproto',
    'read_net', 'read_net_binary', 'schema']
