"""Replacement of cv2.dnn for Caffe networks: `import revisit.dnn as dnn`. Needs only numpy.

OpenCV 5 has no importer for Caffe; install() puts this one into cv2.dnn. docs/OPENCV.md lists the differences.
"""

from .._shared import set_threads
from ._boxes import NMSBoxes, NMSBoxesBatched
from ._images import blobFromImage, blobFromImages, imagesFromBlob
from ._install import install
from ._models import ClassificationModel, DetectionModel, KeypointsModel, Model, SegmentationModel
from ._net import Layer, Net, readNet, readNetFromCaffe, registerLayer

__all__ = ['ClassificationModel', 'DetectionModel', 'KeypointsModel', 'Layer', 'Model', 'NMSBoxes', 'NMSBoxesBatched', 'Net',
           'SegmentationModel', 'blobFromImage', 'blobFromImages', 'imagesFromBlob', 'install', 'readNet', 'readNetFromCaffe',
           'registerLayer', 'set_threads']

(DNN_BACKEND_DEFAULT, DNN_BACKEND_HALIDE, DNN_BACKEND_INFERENCE_ENGINE, DNN_BACKEND_OPENCV, DNN_BACKEND_VKCOM,
 DNN_BACKEND_CUDA, DNN_BACKEND_WEBNN, DNN_BACKEND_TIMVX, DNN_BACKEND_CANN) = range(9)
(DNN_TARGET_CPU, DNN_TARGET_OPENCL, DNN_TARGET_OPENCL_FP16, DNN_TARGET_MYRIAD, DNN_TARGET_VULKAN, DNN_TARGET_FPGA,
 DNN_TARGET_CUDA, DNN_TARGET_CUDA_FP16, DNN_TARGET_HDDL, DNN_TARGET_NPU, DNN_TARGET_CPU_FP16) = range(11)
