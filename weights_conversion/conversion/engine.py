"""Reading old files and running networks, which revisit itself does: its Python module, or where that is not installed its program."""

from google.protobuf import text_format
from google.protobuf.message import DecodeError

try:
    from . import engine_module as revisit
except ImportError:
    from . import engine_program as revisit
from .errors import InputError
from .schema import messages, raw_messages


def read_net(prototxt):
    """The part of a prototxt of any age that inference runs, in the current format (a NetParameter)."""
    try:
        return text_format.Parse(revisit.net_text(prototxt), messages.NetParameter())
    except (text_format.ParseError, UnicodeError) as error:  # names that are not text
        raise InputError(f'{prototxt}: {" ".join(str(error).split())}') from None


def read_weights(file):
    """The layers of a caffemodel of any age or of an HDF5 file, in the current format (a NetParameter of raw_messages)."""
    try:
        return raw_messages.NetParameter.FromString(revisit.weights_bytes(file))
    except DecodeError:
        raise InputError(f'{file}: holds no weights') from None


def forward(prototxt, weights, inputs, end=None, graft=None):
    """Runs a network, cut off after the layer `end`, with a copy of the layer `graft` behind it.

    `weights` is a caffemodel or HDF5 file, or None; `inputs` {blob: array}. Returns {file_name(output): float32 array}.
    """
    return revisit.outputs(prototxt, weights, inputs, end, graft, every_layer=False)


def layer_outputs(prototxt, weights, inputs, end=None, graft=None):
    """The same for the outputs of every layer, by the names 'layer' and 'layer.1'."""
    return revisit.outputs(prototxt, weights, inputs, end, graft, every_layer=True)


def file_name(output):
    """The name of an output in what `forward` and `layer_outputs` return."""
    return output.replace('/', '_')
