"""Exception for functions of pycaffe that need training."""


class TrainingError(NotImplementedError):
    """A script uses training: gradients, solvers, the TRAIN phase.

    This package only runs trained networks. Train with the original Caffe, then load its caffemodel.
    """

    def __init__(self, what):
        super().__init__(
            f'{what} is for training, but this package only runs trained networks; train with the original '
            'Caffe and load the caffemodel with caffe.Net(prototxt, caffe.TEST, weights=...)'
        )
