"""Caffe's files: network descriptions, weights, mean images."""

from revisit._core.proto import (
    Graph, Limits, NetFile, Node, WeightsFile, parse_net, read_binaryproto,
    read_net, read_net_binary, readable_net, resolve, schema)

__all__ = [
    'Graph', 'Limits', 'NetFile', 'Node', 'WeightsFile', 'parse_net',
    'read_binaryproto', 'read_net', 'read_net_binary', 'readable_net', 'resolve', 'schema']
