"""Builder of Caffe networks: prototxt and weights."""

import numpy as np
from google.protobuf import text_format

from revisit.caffe.proto import caffe_pb2

from .errors import InputError


class NetWriter:
    """Adds layers after any blob. Methods return the blob that the layer writes."""

    def __init__(self, name, input_shape, blob='data'):
        self.net, self.blobs = caffe_pb2.NetParameter(name=name), {}
        layer = self.net.layer.add(name=blob, type='Input', top=[blob])
        layer.input_param.shape.add(dim=input_shape)

    def add(self, name, kind, bottoms, arrays=(), in_place=False, **parameters):
        """Adds a layer. arrays: weights. parameters: e.g. convolution_param=dict(...)."""
        bottoms = [bottoms] if isinstance(bottoms, str) else list(bottoms)
        top = bottoms[0] if in_place else name
        self.net.layer.add(name=name, type=kind, bottom=bottoms, top=[top], **parameters)
        if arrays:
            self.blobs[name] = [np.ascontiguousarray(array, np.float32) for array in arrays]
        return top

    def convolution(self, name, bottom, weights, bias=None, stride=1, pad=0, dilation=1):
        """Adds a convolution. weights: [outputs][inputs / groups][h][w]; groups follow from the channels of `bottom`."""
        outputs, per_group, h, w = weights.shape
        channels = self.channels(bottom)
        if channels % per_group:
            raise InputError(f"layer '{name}': weights for {per_group} channels do not match an input of {channels} channels")
        p = dict(num_output=outputs, bias_term=bias is not None, group=channels // per_group)
        p.update(dict(kernel_size=[h]) if h == w else dict(kernel_h=h, kernel_w=w))
        for field, value in (('stride', stride), ('pad', pad)):
            values = (value, value) if isinstance(value, int) else tuple(value)
            if values[0] == values[1]:
                p[field] = [values[0]]
            else:
                p[f'{field}_h'], p[f'{field}_w'] = values
        if dilation != 1:
            p['dilation'] = [dilation]
        return self.add(name, 'Convolution', bottom, [weights] if bias is None else [weights, bias], convolution_param=p)

    def channels(self, blob):
        """Returns the channels of a blob, inferred from the layers that write it."""
        for layer in reversed(self.net.layer):
            if blob not in layer.top:
                continue
            if layer.type == 'Input':
                return layer.input_param.shape[0].dim[1]
            if layer.type == 'Convolution':
                return layer.convolution_param.num_output
            if layer.type == 'Concat':
                return sum(map(self.channels, layer.bottom))
            if layer.bottom[0] != blob:
                blob = layer.bottom[0]
        raise AssertionError(f'no layer writes {blob}')

    def text(self):
        return text_format.MessageToString(self.net)

    def types(self):
        return {layer.name: layer.type for layer in self.net.layer}
