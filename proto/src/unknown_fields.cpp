#include <algorithm>
#include <array>
#include <sstream>
#include <vector>

#include "net_text.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "revisit/proto/net_file.h"

namespace revisit::proto {
namespace {

/// A fork and its layer types, in lower case without underscores.
struct Fork {
  std::string_view name, types;
};
constexpr std::array<Fork, 22> kForks = {{
    {"C3D (facebook/C3D)", "deconvolution3d"},
    {"C3D (facebook/C3D), whose padded pooling is not supported", "pooling3d"},
    {"Caffe itself, internal to its LSTM", "lstmunit"},
    {"Caffe OCR (senlinuc/caffe_ocr)", "ctcdecoder warpctc"},
    {"CRF-as-RNN (torrvision/crfasrnn)", "multistagemeanfield"},
    {"DeepLab (bitbucket.org/aquariusjay/deeplab-public-ver2)",
     "densecrf domaintransform imagesegdata segaccuracy"},
    {"Deformable ConvNets (unsky/Deformable-ConvNets-caffe)",
     "deformableconvolution deformablepsroipooling"},
    {"Faster R-CNN (rbgirshick/caffe-fast-rcnn)", "smoothl1loss"},
    {"FCN (fcn.berkeleyvision.org)", "colormap"},
    {"FCN (longjon/caffe), and its offset cannot be computed", "crop"},
    {"FlowNet (lmb-freiburg/flownet2)",
     "channelnorm correlation correlation1d customdata downsample flowwarp l1loss mean resample"},
    {"gnina (gnina/gnina)", "molgriddata"},
    {"L-Softmax and others", "labelspecificaffine"},
    {"LightCNN (AlfredXiangWu/face_verification_experiment)", "noisylayer"},
    {"MobileNet-YOLO (eric612/MobileNet-YOLO)",
     "regionloss regionoutput yoloseg yolov3 yolov3loss"},
    {"MS-CNN (zhaoweicai/mscnn)",
     "bboxreg detectionaccuracy detectionloss imagegtdata proposaltarget"},
    {"NetVLAD and others", "l2normalize"},
    {"R-FCN (daijifeng001/caffe-rfcn)", "psroialign"},
    {"SegNet (alexgkendall/caffe-segnet)", "denseimagedata"},
    {"SSD (weiliu89/caffe)", "annotateddata detectionevaluate multiboxloss"},
    {"ST-CNN (daerduoCarey/SpatialTransformerLayer)", "spatialtransformer st"},
    {"YOLO (yeahkun/caffe-yolo)", "evaldetection yoloaccuracy"},
}};

using google::protobuf::Descriptor;

/// Messages for training, data input and file output.
constexpr std::array kWithoutEffect = {
    "ContrastiveLossParameter", "DataParameter",       "HDF5DataParameter",
    "HDF5OutputParameter",      "HingeLossParameter",  "ImageDataParameter",
    "InfogainLossParameter",    "MemoryDataParameter", "ParamSpec",
    "ResizeParameter",          "SaveOutputParameter", "TransformationParameter",
    "WindowDataParameter",
};

/// Fields of layers and nets in forks that have no effect on a forward pass: of training, of
/// sharing memory, and DeepLab's check of shared shapes.
constexpr std::array kOfTraining = {
    "bn_stats_batch_size",
    "box_annotator_ohem_param",
    "detection_evaluate_param",
    "eltwise_mem_sharing",
    "force_backward",
    "global_grad_scale",
    "global_grad_scale_adaptive",
    "mem_param",
    "mn_activation_param",
    "mn_grad_compress_param",
    "multinode",
    "optimize_mem",
    "strict_dim",
};

constexpr std::string_view kParam = "_param";
constexpr std::string_view kOfDefault = "default_";  // NVIDIA's nets have defaults for layers

/// Data type fields of NVIDIA's fork. Here all types are FLOAT.
constexpr std::array kNumberTypes = {"forward_type", "backward_type", "forward_math",
                                     "backward_math"};

bool fills(std::string_view field) {
  return field.ends_with("filler") && field != "data_filler";  // DummyData computes with it
}

bool is_layer(const Descriptor& message) {
  return &message == caffe::LayerParameter::descriptor() ||
         &message == caffe::V1LayerParameter::descriptor();
}

bool is_one_of(std::string_view name, const auto& names) {
  return std::ranges::find(names, name) != names.end();
}

std::string_view without_default(std::string_view field) {
  if (field.starts_with(kOfDefault)) field.remove_prefix(kOfDefault.size());
  return field;
}

bool is_number_type(std::string_view field) {
  return is_one_of(without_default(field), kNumberTypes);
}

/// Prefers parameters of layers of `type`.
std::string parameters_with(const std::string& field, const Descriptor& message,
                            const std::string& type) {
  if (!is_layer(message)) return "";
  std::string found;
  for (int i = 0; i < message.field_count(); ++i) {
    const std::string& name = message.field(i)->name();
    const Descriptor* params = message.field(i)->message_type();
    if (!name.ends_with(kParam) || !params || !params->FindFieldByName(field) ||
        is_one_of(params->name(), kWithoutEffect))
      continue;
    std::string its_type = name.substr(0, name.size() - kParam.size());
    std::erase(its_type, '_');
    if (found.empty() || its_type == lower(type)) found = name;
  }
  return found;
}

}  // namespace

std::string fork_of(std::string_view name) {
  if (name.ends_with("_param")) name.remove_suffix(std::string_view("_param").size());
  std::string key = lower(std::string(name));
  std::erase(key, '_');
  for (const Fork& fork : kForks) {
    std::istringstream types{std::string(fork.types)};
    for (std::string type; types >> type;)
      if (type == key) return std::string(fork.name);
  }
  return "";
}

std::string unknown_field(const std::string& field, const Descriptor& message,
                          const std::string& type) {
  std::string hint;
  if (&message == caffe::NetParameter::descriptor() &&
      caffe::SolverParameter::descriptor()->FindFieldByName(field)) {
    hint = " (is this a solver file? give the net it names)";
  } else if (const std::string fork = fork_of(field); is_layer(message) && !fork.empty()) {
    hint = str(" (it is of ", fork, ")");
  } else if (is_number_type(field)) {
    hint = " (a data type of NVIDIA's fork; all types are FLOAT here)";
  } else if (const std::string param = parameters_with(field, message, type); !param.empty()) {
    hint = str(" (did you mean it in '", param, "'?)");
  } else {
    std::vector<std::string> names;
    for (int i = 0; i < message.field_count(); ++i) names.push_back(message.field(i)->name());
    hint = misspelling_hint(field, names, field.ends_with(kParam) ? kParam.size() : 0);
  }
  return str("unknown field '", field, "' in ", message.name(), hint);
}

UnreadPart::Effect effect_of(std::string_view field, const Descriptor& message,
                             std::string_view reached_by, bool is_message) {
  using enum UnreadPart::Effect;
  if (fills(field) || fills(reached_by) || is_one_of(message.name(), kWithoutEffect)) return kNone;
  if (is_one_of(field, kOfTraining) || is_number_type(field)) return kNone;
  if (message.name() == "LossParameter") return kOnLoss;
  // An unknown message field of a net may be a misspelled layer.
  if (&message == caffe::NetParameter::descriptor()) return is_message ? kUnknown : kOutside;
  if (!is_layer(message)) return kUnknown;
  if (field == "quantization_param") return kOnPrecision;
  if (field.ends_with("_loss_param")) return kOnLoss;
  return field.ends_with("_data_param") ? kNone : kOutside;
}

bool is_supported_loss(std::string_view type) {
  return type == "SoftmaxWithLoss" || type == "EuclideanLoss";
}

bool selects_implementation(std::string_view field) {
  constexpr std::array kChoices = {"engine", "conv_algorithm", "conv_algos_override",
                                   "cudnn_math_override", "cudnn_flavor"};
  return is_one_of(without_default(field), kChoices);
}

}  // namespace revisit::proto
