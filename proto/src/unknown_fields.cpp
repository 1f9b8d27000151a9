#include "unknown_fields.h"

#include <algorithm>
#include <array>
#include <vector>

#include "revisit/base/error.h"
#include "revisit/proto/forks.h"

namespace revisit::proto {
namespace {

using google::protobuf::Descriptor;

/// Messages for training, for reading data, and for writing files.
constexpr std::array kWithoutEffect = {
    "ContrastiveLossParameter", "DataParameter",
    "HDF5DataParameter",        "HDF5OutputParameter",
    "HingeLossParameter",       "ImageDataParameter",
    "InfogainLossParameter",    "LossParameter",
    "MemoryDataParameter",      "ParamSpec",
    "ResizeParameter",          "SaveOutputParameter",
    "TransformationParameter",  "WindowDataParameter",
};

/// Fields of layers and nets that forks have for training.
constexpr std::array kOfTraining = {
    "bn_stats_batch_size", "box_annotator_ohem_param", "detection_evaluate_param",
    "force_backward",      "mn_activation_param",      "mn_grad_compress_param",
    "multinode",
};

bool fills(std::string_view field) {
  return field.ends_with("filler") && field != "data_filler";  // which DummyData computes with
}

bool is_layer(const Descriptor& message) {
  return &message == caffe::LayerParameter::descriptor() ||
         &message == caffe::V1LayerParameter::descriptor();
}

bool is_one_of(std::string_view name, const auto& names) {
  return std::ranges::find(names, name) != names.end();
}

}  // namespace

std::string unknown_field(const std::string& field, const Descriptor& message) {
  std::string hint;
  if (&message == caffe::NetParameter::descriptor() &&
      caffe::SolverParameter::descriptor()->FindFieldByName(field)) {
    hint = " (is this a solver file? give the net it names)";
  } else if (const std::string fork = fork_that_has(field); is_layer(message) && !fork.empty()) {
    hint = str(" (it is of ", fork, ")");
  } else {
    std::vector<std::string> names;
    for (int i = 0; i < message.field_count(); ++i) names.push_back(message.field(i)->name());
    hint = did_you_misspell(field, names);
  }
  return str("unknown field '", field, "' in ", message.name(), hint);
}

UnreadPart::Effect effect_of(std::string_view field, const Descriptor& message,
                             std::string_view reached_by) {
  using enum UnreadPart::Effect;
  if (fills(field) || fills(reached_by) || is_one_of(message.name(), kWithoutEffect)) return kNone;
  if (is_one_of(field, kOfTraining)) return kNone;
  if (&message == caffe::NetParameter::descriptor()) return kOutside;
  if (!is_layer(message) || field == "quantization_param") return kUnknown;
  return field.ends_with("_data_param") || field.ends_with("_loss_param") ? kNone : kOutside;
}

bool chooses_engine(std::string_view field) {
  return field == "engine" || field == "conv_algorithm";
}

}  // namespace revisit::proto
