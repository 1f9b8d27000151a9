#include <algorithm>
#include <array>
#include <cctype>
#include <utility>

#include "revisit/proto/net_file.h"

namespace revisit::proto {
namespace {

/// Layer type, in lower case without underscores, and its fork.
using TypeOfFork = std::pair<std::string_view, std::string_view>;

constexpr std::string_view kFasterRcnn = "Faster R-CNN (rbgirshick/caffe-fast-rcnn)";
constexpr std::string_view kMscnn = "MS-CNN (zhaoweicai/mscnn)";
constexpr std::string_view kOcr = "Caffe OCR (senlinuc/caffe_ocr)";
constexpr std::string_view kDeepLab = "DeepLab (bitbucket.org/aquariusjay/deeplab-public-ver2)";
constexpr std::string_view kRfcn = "R-FCN (daijifeng001/caffe-rfcn)";
constexpr std::string_view kSsd = "SSD (weiliu89/caffe)";
constexpr std::string_view kYolo = "MobileNet-YOLO (eric612/MobileNet-YOLO)";
constexpr std::string_view kFlowNet = "FlowNet (lmb-freiburg/flownet2)";

constexpr std::array<TypeOfFork, 50> kTypes = {{
    {"annotateddata", kSsd},
    {"bboxreg", kMscnn},
    {"channelnorm", kFlowNet},
    {"colormap", "FCN (fcn.berkeleyvision.org)"},
    {"continuationindicator", "CRNN (yalecyu/crnn.caffe)"},
    {"convolution3d", "C3D (facebook/C3D)"},
    {"correlation", kFlowNet},
    {"correlation1d", kFlowNet},
    {"crop", "FCN (longjon/caffe), and its offset cannot be computed"},
    {"ctcdecoder", kOcr},
    {"ctcgreedydecoder", kOcr},
    {"customdata", kFlowNet},
    {"deformableconvolution", "Deformable ConvNets (unsky/Deformable-ConvNets-caffe)"},
    {"deformablepsroipooling", "Deformable ConvNets (unsky/Deformable-ConvNets-caffe)"},
    {"densecrf", kDeepLab},
    {"denseimagedata", "SegNet (alexgkendall/caffe-segnet)"},
    {"detectionaccuracy", kMscnn},
    {"detectionevaluate", kSsd},
    {"detectionloss", kMscnn},
    {"domaintransform", kDeepLab},
    {"downsample", kFlowNet},
    {"evaldetection", "YOLO (yeahkun/caffe-yolo)"},
    {"flowwarp", kFlowNet},
    {"frcnnproposal",
     "FRCNN (makefile/frcnn), and its anchors are in a configuration file; the nearest is a "
     "Proposal layer with proposal_param { feat_stride ratio scale min_size ... }"},
    {"imagegtdata", kMscnn},
    {"imagesegdata", kDeepLab},
    {"l1loss", kFlowNet},
    {"l2normalize", "NetVLAD and others"},
    {"labelspecificaffine", "L-Softmax and others"},
    {"lstmunit", "Caffe itself, internal to its LSTM"},
    {"mean", kFlowNet},
    {"molgriddata", "gnina (gnina/gnina)"},
    {"multiboxloss", kSsd},
    {"multistagemeanfield", "CRF-as-RNN (torrvision/crfasrnn)"},
    {"noisylayer", "LightCNN (AlfredXiangWu/face_verification_experiment)"},
    {"pooling3d", "C3D (facebook/C3D)"},
    {"proposaltarget", kMscnn},
    {"psroialign", kRfcn},
    {"regionloss", kYolo},
    {"regionoutput", kYolo},
    {"resample", kFlowNet},
    {"segaccuracy", kDeepLab},
    {"smoothl1loss", kFasterRcnn},
    {"spatialtransformer", "ST-CNN (daerduoCarey/SpatialTransformerLayer)"},
    {"st", "ST-CNN (daerduoCarey/SpatialTransformerLayer)"},
    {"warpctc", kOcr},
    {"yoloaccuracy", "YOLO (yeahkun/caffe-yolo)"},
    {"yoloseg", kYolo},
    {"yolov3", kYolo},
    {"yolov3loss", kYolo},
}};

}  // namespace

std::string fork_of(std::string_view name) {
  if (name.ends_with("_param")) name.remove_suffix(std::string_view("_param").size());
  std::string key(name);
  std::erase(key, '_');
  std::ranges::transform(key, key.begin(), [](unsigned char c) { return std::tolower(c); });
  const auto* const found = std::ranges::find(kTypes, key, &TypeOfFork::first);
  return found == kTypes.end() ? "" : std::string(found->second);
}

}  // namespace revisit::proto
