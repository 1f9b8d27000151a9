"""Network definition in Python: caffe.NetSpec, caffe.layers and caffe.params.

from revisit.caffe import NetSpec, layers as L, params as P
n = NetSpec()
n.data = L.Input(shape=dict(dim=[1, 3, 227, 227]))
n.conv1 = L.Convolution(n.data, kernel_size=11, num_output=96, stride=4)
n.pool1 = L.Pooling(n.conv1, kernel_size=3, stride=2, pool=P.Pooling.MAX)
print(n.to_proto())
"""

from collections import Counter, OrderedDict

from .proto import caffe_pb2


# Layer type -> field of LayerParameter with its parameters: the first with its message, because C3D's twins are behind.
_PARAMS = {field.message_type.name.removesuffix('Parameter'): field.name
           for field in reversed(caffe_pb2.LayerParameter.DESCRIPTOR.fields) if field.name.endswith('_param')}


def assign_proto(proto, name, val):
    """Sets a field of a message: a submessage from a dict, a repeated field from a list or a value."""
    field = proto.DESCRIPTOR.fields_by_name.get(name)
    if field is None:
        raise AttributeError(f"{proto.DESCRIPTOR.name} has no field '{name}'")
    repeated = hasattr(getattr(proto, name), 'extend')
    if repeated:
        for item in val if isinstance(val, (list, tuple)) else [val]:
            if isinstance(item, dict):
                _assign_all(getattr(proto, name).add(), item)
            else:
                getattr(proto, name).append(item)
    elif isinstance(val, dict):
        getattr(proto, name).SetInParent()
        _assign_all(getattr(proto, name), val)
    else:
        setattr(proto, name, val)


def _assign_all(proto, values):
    for name, val in values.items():
        assign_proto(proto, name, val)


class Top:
    """One output of a layer."""

    def __init__(self, fn, n):
        self.fn = fn
        self.n = n

    def to_proto(self):
        """Returns a NetParameter of the layers that this output needs."""
        return to_proto(self)


class Function:
    """A layer: type, inputs (outputs of other layers) and parameters."""

    def __init__(self, type_name, inputs, params):
        for index, source in enumerate(inputs):
            if not isinstance(source, Top):
                raise TypeError(f'{type_name} input {index} is not a Top (type is {type(source)})')
        self.type_name = type_name
        self.inputs = inputs
        self.params = dict(params)
        self.ntop = self.params.pop('ntop', 1)
        self.in_place = self.params.pop('in_place', False)
        self.tops = tuple(Top(self, n) for n in range(self.ntop))

    def fill(self, layer):
        """Sets the type and parameters of a LayerParameter."""
        layer.type = self.type_name
        own = _PARAMS.get(self.type_name)
        for name, value in self.params.items():
            is_own = own and not name.endswith('param') and name in getattr(layer, own).DESCRIPTOR.fields_by_name
            assign_proto(getattr(layer, own) if is_own else layer, name, value)


class _Writer:
    """Writes layers in topological order and generates missing names."""

    def __init__(self, names):
        self.net = caffe_pb2.NetParameter()
        self._names = names  # of tops and layers
        self._written = {}  # Function -> names of its tops
        self._numbers = Counter()

    def _name(self, what, type_name):
        if what not in self._names:
            self._numbers[type_name] += 1
            self._names[what] = f'{type_name}{self._numbers[type_name]}'
        return self._names[what]

    def write(self, fn):
        pending = [(fn, False)]  # iterative, because deep nets would exceed Python's recursion limit
        while pending:
            fn, inputs_are_written = pending.pop()
            if fn in self._written:
                continue
            if inputs_are_written:
                self._write_one(fn)
            else:
                pending.append((fn, True))
                pending += [(top.fn, False) for top in reversed(fn.inputs)]

    def _write_one(self, fn):
        layer = caffe_pb2.LayerParameter()
        layer.bottom.extend(self._written[top.fn][top.n] for top in fn.inputs)
        if fn.in_place:
            layer.top.extend(layer.bottom)
        else:
            layer.top.extend(self._name(top, fn.type_name) for top in fn.tops)
        layer.name = self._name(fn.tops[0] if fn.tops else fn, fn.type_name)
        fn.fill(layer)
        self._written[fn] = list(layer.top)
        self.net.layer.append(layer)


def to_proto(*tops):
    """Returns a NetParameter of the layers that the outputs need, with generated names."""
    writer = _Writer({})
    for top in tops:
        writer.write(top.fn if isinstance(top, Top) else top)
    return writer.net


class NetSpec:
    """Named outputs, accessible as attributes or items."""

    def __init__(self):
        super().__setattr__('tops', OrderedDict())

    def __setattr__(self, name, value):
        self.tops[name] = value

    def __getattr__(self, name):
        try:
            return self.tops[name]
        except KeyError:
            raise AttributeError(f"this NetSpec has no '{name}'") from None

    def __setitem__(self, key, value):
        self.tops[key] = value

    def __getitem__(self, key):
        return self.tops[key]

    def __delitem__(self, key):
        del self.tops[key]

    def keys(self):
        """Returns the names."""
        return self.tops.keys()

    def to_proto(self):
        """Returns a NetParameter of the layers that the outputs need."""
        writer = _Writer({top: name for name, top in self.tops.items()})
        for top in self.tops.values():
            writer.write(top.fn if isinstance(top, Top) else top)
        return writer.net


class _Layers:
    """layers.Convolution(bottom, kernel_size=3) creates a layer and returns its output."""

    def __getattr__(self, type_name):
        if type_name.startswith('__'):
            raise AttributeError(type_name)

        def layer(*inputs, **params):
            fn = Function(type_name, inputs, params)
            return {0: fn, 1: fn.tops[0] if fn.tops else None}.get(fn.ntop, fn.tops)

        return layer


class _Params:
    """params.Pooling.MAX is a constant of PoolingParameter."""

    def __getattr__(self, name):
        if name.startswith('__'):
            raise AttributeError(name)
        return getattr(caffe_pb2, name + 'Parameter')


layers = _Layers()
params = _Params()
