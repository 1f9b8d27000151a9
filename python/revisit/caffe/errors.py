"""What a script asked for that needs training."""


class TrainingError(NotImplementedError):
    """A script asked for training: gradients, solvers, the TRAIN phase.

    This package runs trained networks. Train with the original Caffe, then load its caffemodel here.
    """

    def __init__(self, what):
        super().__init__(
            f'{what} is for training, and this package only runs trained networks. Train with the original '
            'Caffe and load the caffemodel with caffe.Net(prototxt, caffe.TEST, weights=...).'
        )
