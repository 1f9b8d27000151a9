#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "caffe_schema.pb.h"
#include "revisit/base/error.h"
#include "revisit/proto/net_file.h"

namespace revisit::proto {

/// A net that cannot be upgraded, because of entry `index` of NetParameter's `field` in the file.
/// Callers rethrow it as InputError with the line.
struct UpgradeError : Error {
  template <class... Parts>
  UpgradeError(std::string field_name, int field_index, const Parts&... reason)
      : Error(reason...), field(std::move(field_name)), index(field_index) {}
  std::string field;
  int index;
};

/// Marks a layer with an error. `index` is its index in the file's `layers`, or -1 if unknown.
using Blame = std::function<void(google::protobuf::Message& layer, std::string reason, int index)>;

enum class ShapelessInputs {
  kDropped,  // removed, by Caffe's rule: the upgraded file equals Caffe's
  kKept      // becomes an Input layer without a shape, which the loader may know
};

/// A Crop without crop_param for which a fork would compute an offset.
enum class AmbiguousCrops {
  kErrors,
  kStartAtZero  // with a warning, as in Caffe
};

/// Upgrades a net of any generation to V2, in Caffe's order. Throws UpgradeError for errors of the
/// net; errors of layers go to `blame`.
void upgrade(caffe::NetParameter& net, ShapelessInputs inputs, AmbiguousCrops crops,
             const Blame& blame, std::vector<std::string>& warnings);

/// Converts V0 layers (2013: one flat message inside V1's `layer`) to V1 layers, and merges padding
/// layers into the convolution or pooling that follows. A net without V0 layers is unchanged. Warns
/// about parameters without meaning for the type of a layer.
void upgrade_v0(caffe::NetParameter& net, const Blame& blame, std::vector<std::string>& warnings);

/// Returns the V2 type for a V1 type, or for one of a fork that V1 lacks; "" if there is none.
std::string type_of_v1(std::string capitals);

/// Sets field `name` in the sub-message `message` of `to` to the value of a set field with another
/// name, via text. Returns false if the value does not fit.
bool merge_field(const google::protobuf::Message& from,
                 const google::protobuf::FieldDescriptor& field, const std::string& message,
                 const std::string& name, google::protobuf::Message& to);

/// Type of the Crop in FCN's fork (V1's CROP), whose offset aligns the pixels of both inputs.
constexpr const char* kAligningCrop = "CROP";

/// Converts crops of that type to Caffe's Crop with the computed offset, where possible.
void find_crop_offsets(caffe::NetParameter& net, AmbiguousCrops crops, const Blame& blame,
                       std::vector<std::string>& warnings);

/// Gives Python layers of public forks a type that computes the same. ProposalLayer of Faster R-CNN
/// becomes a Proposal layer if all of its `param_str` is known. Settings of its other files
/// (config.py, generate_anchors.py) are those of rbgirshick/py-faster-rcnn; a warning lists them.
/// The layer keeps its `python_param`, which tells the engine to drop small regions instead of
/// setting their score to 0.
void replace_python_layers(caffe::NetParameter& net, bool keep_python,
                           std::vector<std::string>& warnings);

/// Corrects the shape of inputs with too few numbers for regions or image sizes. pycaffe's callers
/// give such inputs another shape before they run the net.
void widen_inputs(caffe::NetParameter& net, std::vector<std::string>& warnings);

/// Reduces a V2 net to inference: the layers of the state and, if it reads training data (a
/// train_val.prototxt), the part between data and prediction. Data layers become Input layers, with
/// a shape if the file has one. Losses, Accuracy and label layers are skipped. A sole
/// SoftmaxWithLoss becomes the Softmax of a deploy prototxt. Values that depend on types with
/// weights are predictions, not labels. Sets `skipped` and `dropped` of the file.
void keep_inference(NetFile& file, const NetReadOptions& options, const Blame& blame,
                    std::vector<std::string>& warnings);

}  // namespace revisit::proto
