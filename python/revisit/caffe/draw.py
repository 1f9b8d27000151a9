"""Pictures of nets, as pycaffe's module of that name: needs the package pydot and the program dot (Graphviz)."""

import os

from .proto import caffe_pb2  # noqa: F401  pycaffe's module has it, too

BLOB_STYLE = {'shape': 'octagon', 'fillcolor': '#E0E0E0', 'style': 'filled'}
LAYER_STYLE = {'shape': 'record', 'style': 'filled'}
_COLORS = {'Convolution': '#FF5050', 'Deconvolution': '#FF5050', 'Pooling': '#FF9900', 'InnerProduct': '#CC33FF'}


def choose_color_by_layertype(layertype):
    """Returns the color of a layer type, #RRGGBB."""
    return _COLORS.get(layertype, '#6495ED')


def get_edge_label(layer):
    """Returns the number of outputs of a layer with weights, the batch size of a data layer, else nothing."""
    if layer.type == 'Data':
        return f'Batch {layer.data_param.batch_size}'
    counts = {'Convolution': layer.convolution_param, 'Deconvolution': layer.convolution_param, 'InnerProduct': layer.inner_product_param}
    return str(counts[layer.type].num_output) if layer.type in counts else ''


def get_layer_label(layer, rankdir, display_lrm=False):
    """Returns name, type and window of a layer, on lines if the graph grows to the side ('LR')."""
    parts = [layer.name, f'({layer.type})']
    if layer.type in ('Convolution', 'Deconvolution'):
        p = layer.convolution_param
        kernel, stride, pad = (next(iter(values), default)
                               for values, default in ((p.kernel_size, p.kernel_h or 1), (p.stride, 1), (p.pad, 0)))
        parts.append(f'kernel size: {kernel} stride: {stride} pad: {pad}')
    elif layer.type == 'Pooling':
        p = layer.pooling_param
        parts.append(f'{p.PoolMethod.Name(p.pool)} kernel size: {p.kernel_size} stride: {p.stride} pad: {p.pad}')
    if display_lrm and layer.param:
        parts.append('lr mult: ' + ' '.join(f'{param.lr_mult:g}' for param in layer.param))
    return (' ' if rankdir in ('TB', 'BT') else '\\n').join(parts)


def _runs_in(layer, phase):
    def names(rules):
        return [rule.phase for rule in rules if rule.HasField('phase')]
    return phase is None or ((not names(layer.include) or phase in names(layer.include)) and phase not in names(layer.exclude))


def get_pydot_graph(caffe_net, rankdir, label_edges=True, phase=None, display_lrm=False):
    """Returns the graph of a caffe_pb2.NetParameter as a pydot.Dot.

    rankdir: 'LR', 'TB' or 'BT'. phase: caffe.TRAIN or caffe.TEST, to leave out layers of the other; None: all layers.
    Raises ImportError without pydot.
    """
    try:
        import pydot
    except ImportError as error:
        raise ImportError('caffe.draw needs the package pydot and Graphviz: pip install pydot, apt install graphviz') from error
    graph = pydot.Dot(caffe_net.name or 'Net', graph_type='digraph', rankdir=rankdir)
    blobs = set()
    for i, layer in enumerate(layer for layer in caffe_net.layer if _runs_in(layer, phase)):
        node = pydot.Node(f'layer{i}', label=f'"{get_layer_label(layer, rankdir, display_lrm)}"',
                          fillcolor=choose_color_by_layertype(layer.type), **LAYER_STYLE)
        graph.add_node(node)
        for blob in (*layer.bottom, *layer.top):
            if blob not in blobs:
                blobs.add(blob)
                graph.add_node(pydot.Node(f'"blob_{blob}"', label=f'"{blob}"', **BLOB_STYLE))
        for blob in layer.bottom:
            graph.add_edge(pydot.Edge(f'"blob_{blob}"', f'layer{i}'))
        for blob in layer.top:
            graph.add_edge(pydot.Edge(f'layer{i}', f'"blob_{blob}"', label=f'"{get_edge_label(layer) if label_edges else ""}"'))
    return graph


def draw_net(caffe_net, rankdir, ext='png', phase=None, display_lrm=False):
    """Returns the picture of a caffe_pb2.NetParameter as bytes of the format `ext`."""
    return get_pydot_graph(caffe_net, rankdir, phase=phase, display_lrm=display_lrm).create(format=ext)


def draw_net_to_file(caffe_net, filename, rankdir='LR', phase=None, display_lrm=False):
    """Writes the picture of a caffe_pb2.NetParameter to a file, whose ending gives the format."""
    ext = os.path.splitext(filename)[1][1:] or 'png'
    with open(filename, 'wb') as file:
        file.write(draw_net(caffe_net, rankdir, ext, phase, display_lrm))
