#include <algorithm>
#include <array>
#include <map>
#include <sstream>

#include "net_text.h"
#include "revisit/base/text.h"
#include "upgrade.h"

namespace revisit::proto {
namespace {

using V0 = caffe::V0LayerParameter;
using V1 = caffe::V1LayerParameter;
using google::protobuf::FieldDescriptor;

/// A layer type, and the V0 fields that V1 keeps in the type's own message (`convolution_param` of
/// CONVOLUTION): a name, or "V0's=V1's". Training data and losses are included for `net upgrade`.
struct LayerKind {
  const char* v0;
  V1::LayerType v1;
  const char* fields;
};
constexpr std::array<LayerKind, 24> kV0Types = {{
    {"accuracy", V1::ACCURACY, ""},
    {"bnll", V1::BNLL, ""},
    {"concat", V1::CONCAT, "concat_dim"},
    {"conv", V1::CONVOLUTION,
     "num_output biasterm=bias_term weight_filler bias_filler pad kernelsize=kernel_size stride "
     "group"},
    {"data", V1::DATA, "source batchsize=batch_size rand_skip"},
    {"dropout", V1::DROPOUT, "dropout_ratio"},
    {"euclidean_loss", V1::EUCLIDEAN_LOSS, ""},
    {"flatten", V1::FLATTEN, ""},
    {"hdf5_data", V1::HDF5_DATA, "source batchsize=batch_size"},
    {"hdf5_output", V1::HDF5_OUTPUT, ""},
    {"im2col", V1::IM2COL, ""},
    {"images", V1::IMAGE_DATA,
     "source batchsize=batch_size rand_skip shuffle_images=shuffle new_height new_width"},
    {"infogain_loss", V1::INFOGAIN_LOSS, "source"},
    {"innerproduct", V1::INNER_PRODUCT, "num_output biasterm=bias_term weight_filler bias_filler"},
    {"lrn", V1::LRN, "local_size alpha beta k"},
    {"multinomial_logistic_loss", V1::MULTINOMIAL_LOGISTIC_LOSS, ""},
    {"pool", V1::POOLING, "pad kernelsize=kernel_size stride pool"},
    {"relu", V1::RELU, ""},
    {"sigmoid", V1::SIGMOID, ""},
    {"softmax", V1::SOFTMAX, ""},
    {"softmax_loss", V1::SOFTMAX_LOSS, ""},
    {"split", V1::SPLIT, ""},
    {"tanh", V1::TANH, ""},
    {"window_data", V1::WINDOW_DATA,
     "source batchsize=batch_size det_fg_threshold=fg_threshold det_bg_threshold=bg_threshold "
     "det_fg_fraction=fg_fraction det_context_pad=context_pad det_crop_mode=crop_mode"},
}};
constexpr const char* kTransformFields = "scale meanfile=mean_file cropsize=crop_size mirror";
constexpr const char* kPadding = "padding";

const LayerKind* kind_of(const std::string& v0) {
  const auto* kind = std::ranges::find_if(kV0Types, [&](const LayerKind& k) { return v0 == k.v0; });
  return kind == kV0Types.end() ? nullptr : kind;
}

std::string unknown_type(const std::string& v0) {
  std::vector<std::string> names = {kPadding};
  for (const LayerKind& k : kV0Types) names.emplace_back(k.v0);
  return str("unknown V0 layer type '", v0, "'", nearest_name_hint(v0, names));
}

std::string renamed(const std::string& v0, const char* fields) {
  std::istringstream words(fields);
  for (std::string word; words >> word;) {
    const size_t equals = std::min(word.find('='), word.size());
    if (word.compare(0, equals, v0) == 0)
      return equals < word.size() ? word.substr(equals + 1) : v0;
  }
  return "";
}

bool carry_over(const V0& v0, const FieldDescriptor& field, const LayerKind& kind, V1& v1) {
  if (const std::string name = renamed(field.name(), kTransformFields); !name.empty())
    return merge_field(v0, field, "transform_param", name, v1);
  if (field.number() == V0::kHdf5OutputParamFieldNumber && kind.v1 == V1::HDF5_OUTPUT) {
    *v1.mutable_hdf5_output_param() = v0.hdf5_output_param();
    return true;
  }
  const std::string name = renamed(field.name(), kind.fields);
  const std::string message = lower(V1::LayerType_Name(kind.v1)) + "_param";
  return !name.empty() && merge_field(v0, field, message, name, v1);
}

V1 upgrade_layer(const V1& shell, int index, const Blame& blame,
                 std::vector<std::string>& warnings) {
  const V0& v0 = shell.layer();
  V1 v1;
  *v1.mutable_bottom() = shell.bottom();
  *v1.mutable_top() = shell.top();
  if (v0.has_name()) v1.set_name(v0.name());
  copy_marks(shell, v1);
  LayerKind kind{"", V1::NONE, ""};
  if (v0.has_type()) {
    const LayerKind* known = kind_of(v0.type());
    if (!known) {
      blame(v1, unknown_type(v0.type()), index);
      return v1;
    }
    kind = *known;
    v1.set_type(kind.v1);
  }
  *v1.mutable_blobs() = v0.blobs();
  *v1.mutable_blobs_lr() = v0.blobs_lr();
  *v1.mutable_weight_decay() = v0.weight_decay();

  std::vector<const FieldDescriptor*> fields;
  V0::GetReflection()->ListFields(v0, &fields);
  for (const FieldDescriptor* field : fields) {
    const int number = field->number();
    if (number == V0::kNameFieldNumber || number == V0::kTypeFieldNumber ||
        number == V0::kBlobsFieldNumber || number == V0::kBlobsLrFieldNumber ||
        number == V0::kWeightDecayFieldNumber || carry_over(v0, *field, kind, v1))
      continue;
    warnings.push_back(str("layer '", v0.name(), "': ", field->name(),
                           " has no meaning for V0 type '", v0.type(), "' and is ignored"));
  }
  fields.clear();
  V1::GetReflection()->ListFields(shell, &fields);
  for (const FieldDescriptor* field : fields) {
    const int number = field->number();
    if (number == V1::kLayerFieldNumber || number == V1::kBottomFieldNumber ||
        number == V1::kTopFieldNumber)
      continue;
    warnings.push_back(str("layer '", v0.name(), "': V1 field ", field->name(),
                           " next to a V0 layer is ignored, as in Caffe"));
  }
  return v1;
}

/// Index of the layer that last wrote each blob; kInput for the net's inputs.
using Producers = std::map<std::string, int>;
constexpr int kInput = -1;

/// If bottom `j` of layer `index` comes from a padding layer, moves its pad and bottom to `layer`.
void fold_padding(const caffe::NetParameter& net, const Producers& producers, int index, int j,
                  V1& layer, const Blame& blame, std::vector<std::string>& warnings) {
  const auto producer = producers.find(net.layers(index).bottom(j));
  if (producer == producers.end() || producer->second == kInput) return;
  const V1& source = net.layers(producer->second);
  if (source.layer().type() != kPadding) return;

  copy_marks(source, layer);
  V0& v0 = *layer.mutable_layer();
  const char* wrong = nullptr;
  if (source.bottom_size() != 1 || source.top_size() != 1)
    wrong = "a padding layer needs one bottom and one top";
  if (layer.bottom_size() != 1) wrong = "expected one bottom";
  if (v0.type() != "conv" && v0.type() != "pool")
    wrong = "only conv and pool can follow a padding layer";
  if (wrong) {
    blame(layer, str("after padding layer '", source.layer().name(), "': ", wrong), index);
    layer.clear_bottom();  // because no layer of the upgraded net writes it
    return;
  }
  if (v0.pad() != 0)
    warnings.push_back(str("layer '", v0.name(), "': its pad ", v0.pad(), " is replaced by pad ",
                           source.layer().pad(), " of padding layer '", source.layer().name(),
                           "', as in Caffe"));
  v0.set_pad(source.layer().pad());
  layer.set_bottom(j, source.bottom(0));
}

}  // namespace

void upgrade_v0(caffe::NetParameter& net, const Blame& blame, std::vector<std::string>& warnings) {
  if (std::ranges::none_of(net.layers(), [](const V1& layer) { return layer.has_layer(); })) return;

  Producers producers;
  for (const std::string& input : net.input()) producers[input] = kInput;
  google::protobuf::RepeatedPtrField<V1> upgraded;
  for (int i = 0; i < net.layers_size(); ++i) {
    V1 layer = net.layers(i);
    if (!layer.has_layer())
      blame(layer, "V1 layer in a net with V0 layers (`layers { layer {`)", i);
    for (int j = 0; j < layer.bottom_size(); ++j)
      fold_padding(net, producers, i, j, layer, blame, warnings);
    for (const std::string& top : layer.top()) producers[top] = i;
    if (layer.layer().type() != kPadding)
      *upgraded.Add() = layer.has_layer() ? upgrade_layer(layer, i, blame, warnings) : layer;
  }
  *net.mutable_layers() = std::move(upgraded);
}

}  // namespace revisit::proto
