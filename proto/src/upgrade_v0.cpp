#include "upgrade_v0.h"

#include <algorithm>
#include <array>
#include <map>
#include <optional>

#include "revisit/proto/error.h"
#include "upgrade.h"
#include "upgrade_v1.h"

namespace revisit::proto {
namespace {

using V0 = caffe::V0LayerParameter;
using V1 = caffe::V1LayerParameter;
using google::protobuf::FieldDescriptor;

struct TypeName {
  const char* v0;
  V1::LayerType v1;
};
constexpr std::array<TypeName, 24> kTypes = {{
    {"accuracy", V1::ACCURACY},
    {"bnll", V1::BNLL},
    {"concat", V1::CONCAT},
    {"conv", V1::CONVOLUTION},
    {"data", V1::DATA},
    {"dropout", V1::DROPOUT},
    {"euclidean_loss", V1::EUCLIDEAN_LOSS},
    {"flatten", V1::FLATTEN},
    {"hdf5_data", V1::HDF5_DATA},
    {"hdf5_output", V1::HDF5_OUTPUT},
    {"im2col", V1::IM2COL},
    {"images", V1::IMAGE_DATA},
    {"infogain_loss", V1::INFOGAIN_LOSS},
    {"innerproduct", V1::INNER_PRODUCT},
    {"lrn", V1::LRN},
    {"multinomial_logistic_loss", V1::MULTINOMIAL_LOGISTIC_LOSS},
    {"pool", V1::POOLING},
    {"relu", V1::RELU},
    {"sigmoid", V1::SIGMOID},
    {"softmax", V1::SOFTMAX},
    {"softmax_loss", V1::SOFTMAX_LOSS},
    {"split", V1::SPLIT},
    {"tanh", V1::TANH},
    {"window_data", V1::WINDOW_DATA},
}};
constexpr const char* kPadding = "padding";

std::optional<V1::LayerType> v1_type(const std::string& type) {
  const auto* found = std::ranges::find_if(kTypes, [&](const TypeName& t) { return type == t.v0; });
  if (found == kTypes.end()) return std::nullopt;
  return found->v1;
}

V1::LayerType v1_type_or_throw(const std::string& type, int index) {
  if (const auto known = v1_type(type)) return *known;
  std::vector<std::string> names = {kPadding};
  for (const TypeName& t : kTypes) names.emplace_back(t.v0);
  throw UpgradeError("layers", index,
                     str("unknown V0 layer type '", type, "'", did_you_mean(type, names)));
}

/// Carries one set V0 field over to where V1 keeps it. False when it means nothing for the type.
bool carry_over(const V0& v0, int number, V1& v1) {
  const V1::LayerType type = v1.type();
  const bool conv = type == V1::CONVOLUTION, pool = type == V1::POOLING;
  const bool inner = type == V1::INNER_PRODUCT, lrn = type == V1::LRN;
  const bool data = type == V1::DATA, hdf5 = type == V1::HDF5_DATA;
  const bool images = type == V1::IMAGE_DATA, windows = type == V1::WINDOW_DATA;
  switch (number) {
    case V0::kNumOutputFieldNumber:
      if (conv) v1.mutable_convolution_param()->set_num_output(v0.num_output());
      if (inner) v1.mutable_inner_product_param()->set_num_output(v0.num_output());
      return conv || inner;
    case V0::kBiastermFieldNumber:
      if (conv) v1.mutable_convolution_param()->set_bias_term(v0.biasterm());
      if (inner) v1.mutable_inner_product_param()->set_bias_term(v0.biasterm());
      return conv || inner;
    case V0::kWeightFillerFieldNumber:
      if (conv) *v1.mutable_convolution_param()->mutable_weight_filler() = v0.weight_filler();
      if (inner) *v1.mutable_inner_product_param()->mutable_weight_filler() = v0.weight_filler();
      return conv || inner;
    case V0::kBiasFillerFieldNumber:
      if (conv) *v1.mutable_convolution_param()->mutable_bias_filler() = v0.bias_filler();
      if (inner) *v1.mutable_inner_product_param()->mutable_bias_filler() = v0.bias_filler();
      return conv || inner;
    case V0::kPadFieldNumber:
      if (conv) v1.mutable_convolution_param()->add_pad(v0.pad());
      if (pool) v1.mutable_pooling_param()->set_pad(v0.pad());
      return conv || pool;
    case V0::kKernelsizeFieldNumber:
      if (conv) v1.mutable_convolution_param()->add_kernel_size(v0.kernelsize());
      if (pool) v1.mutable_pooling_param()->set_kernel_size(v0.kernelsize());
      return conv || pool;
    case V0::kStrideFieldNumber:
      if (conv) v1.mutable_convolution_param()->add_stride(v0.stride());
      if (pool) v1.mutable_pooling_param()->set_stride(v0.stride());
      return conv || pool;
    case V0::kGroupFieldNumber:
      if (conv) v1.mutable_convolution_param()->set_group(v0.group());
      return conv;
    case V0::kPoolFieldNumber:  // the methods have the same numbers in both
      if (pool) {
        v1.mutable_pooling_param()->set_pool(
            static_cast<caffe::PoolingParameter::PoolMethod>(v0.pool()));
      }
      return pool;
    case V0::kDropoutRatioFieldNumber:
      if (type != V1::DROPOUT) return false;
      v1.mutable_dropout_param()->set_dropout_ratio(v0.dropout_ratio());
      return true;
    case V0::kLocalSizeFieldNumber:
      if (lrn) v1.mutable_lrn_param()->set_local_size(v0.local_size());
      return lrn;
    case V0::kAlphaFieldNumber:
      if (lrn) v1.mutable_lrn_param()->set_alpha(v0.alpha());
      return lrn;
    case V0::kBetaFieldNumber:
      if (lrn) v1.mutable_lrn_param()->set_beta(v0.beta());
      return lrn;
    case V0::kKFieldNumber:
      if (lrn) v1.mutable_lrn_param()->set_k(v0.k());
      return lrn;
    case V0::kConcatDimFieldNumber:
      if (type != V1::CONCAT) return false;
      v1.mutable_concat_param()->set_concat_dim(v0.concat_dim());
      return true;

    // Training data and losses: never run, but written back by `net upgrade`.
    case V0::kSourceFieldNumber:
      if (data) v1.mutable_data_param()->set_source(v0.source());
      if (hdf5) v1.mutable_hdf5_data_param()->set_source(v0.source());
      if (images) v1.mutable_image_data_param()->set_source(v0.source());
      if (windows) v1.mutable_window_data_param()->set_source(v0.source());
      if (type == V1::INFOGAIN_LOSS) v1.mutable_infogain_loss_param()->set_source(v0.source());
      return data || hdf5 || images || windows || type == V1::INFOGAIN_LOSS;
    case V0::kBatchsizeFieldNumber:
      if (data) v1.mutable_data_param()->set_batch_size(v0.batchsize());
      if (hdf5) v1.mutable_hdf5_data_param()->set_batch_size(v0.batchsize());
      if (images) v1.mutable_image_data_param()->set_batch_size(v0.batchsize());
      if (windows) v1.mutable_window_data_param()->set_batch_size(v0.batchsize());
      return data || hdf5 || images || windows;
    case V0::kRandSkipFieldNumber:
      if (data) v1.mutable_data_param()->set_rand_skip(v0.rand_skip());
      if (images) v1.mutable_image_data_param()->set_rand_skip(v0.rand_skip());
      return data || images;
    case V0::kScaleFieldNumber:
      v1.mutable_transform_param()->set_scale(v0.scale());
      return true;
    case V0::kMeanfileFieldNumber:
      v1.mutable_transform_param()->set_mean_file(v0.meanfile());
      return true;
    case V0::kCropsizeFieldNumber:
      v1.mutable_transform_param()->set_crop_size(v0.cropsize());
      return true;
    case V0::kMirrorFieldNumber:
      v1.mutable_transform_param()->set_mirror(v0.mirror());
      return true;
    case V0::kShuffleImagesFieldNumber:
      if (images) v1.mutable_image_data_param()->set_shuffle(v0.shuffle_images());
      return images;
    case V0::kNewHeightFieldNumber:
      if (images)
        v1.mutable_image_data_param()->set_new_height(static_cast<uint32_t>(v0.new_height()));
      return images;
    case V0::kNewWidthFieldNumber:
      if (images)
        v1.mutable_image_data_param()->set_new_width(static_cast<uint32_t>(v0.new_width()));
      return images;
    case V0::kDetFgThresholdFieldNumber:
      if (windows) v1.mutable_window_data_param()->set_fg_threshold(v0.det_fg_threshold());
      return windows;
    case V0::kDetBgThresholdFieldNumber:
      if (windows) v1.mutable_window_data_param()->set_bg_threshold(v0.det_bg_threshold());
      return windows;
    case V0::kDetFgFractionFieldNumber:
      if (windows) v1.mutable_window_data_param()->set_fg_fraction(v0.det_fg_fraction());
      return windows;
    case V0::kDetContextPadFieldNumber:
      if (windows) v1.mutable_window_data_param()->set_context_pad(v0.det_context_pad());
      return windows;
    case V0::kDetCropModeFieldNumber:
      if (windows) v1.mutable_window_data_param()->set_crop_mode(v0.det_crop_mode());
      return windows;
    case V0::kHdf5OutputParamFieldNumber:
      if (type != V1::HDF5_OUTPUT) return false;
      *v1.mutable_hdf5_output_param() = v0.hdf5_output_param();
      return true;
    default:
      return false;
  }
}

void warn_ignored(const std::string& layer, const std::string& field, const std::string& type,
                  std::vector<std::string>& warnings) {
  warnings.push_back(str("layer '", layer, "': ", field, " means nothing for V0 type '", type,
                         "' and is ignored"));
}

V1 upgrade_layer(const V1& shell, int index, std::vector<std::string>& warnings) {
  const V0& v0 = shell.layer();
  V1 v1;
  *v1.mutable_bottom() = shell.bottom();
  *v1.mutable_top() = shell.top();
  if (v0.has_name()) v1.set_name(v0.name());
  if (v0.has_type()) v1.set_type(v1_type_or_throw(v0.type(), index));
  *v1.mutable_blobs() = v0.blobs();
  *v1.mutable_blobs_lr() = v0.blobs_lr();
  *v1.mutable_weight_decay() = v0.weight_decay();

  std::vector<const FieldDescriptor*> fields;
  V0::GetReflection()->ListFields(v0, &fields);
  for (const FieldDescriptor* field : fields) {
    const int number = field->number();
    if (number == V0::kNameFieldNumber || number == V0::kTypeFieldNumber ||
        number == V0::kBlobsFieldNumber || number == V0::kBlobsLrFieldNumber ||
        number == V0::kWeightDecayFieldNumber || carry_over(v0, number, v1)) {
      continue;
    }
    warn_ignored(v0.name(), field->name(), v0.type(), warnings);
  }
  fields.clear();
  V1::GetReflection()->ListFields(shell, &fields);
  for (const FieldDescriptor* field : fields) {
    const int number = field->number();
    if (number == V1::kLayerFieldNumber || number == V1::kBottomFieldNumber ||
        number == V1::kTopFieldNumber) {
      continue;
    }
    warnings.push_back(str("layer '", v0.name(), "': V1 field ", field->name(),
                           " beside a V0 layer is ignored, as in Caffe"));
  }
  return v1;
}

/// Which layer of the file made each blob last; kInput for the net's inputs.
using Producers = std::map<std::string, int>;
constexpr int kInput = -1;

/// When bottom `j` of layer `index` comes from a padding layer: gives `layer` its pad and its
/// bottom.
void fold_padding(const caffe::NetParameter& net, const Producers& producers, int index, int j,
                  V1& layer, std::vector<std::string>& warnings) {
  const std::string& blob = net.layers(index).bottom(j);
  const auto producer = producers.find(blob);
  if (producer == producers.end()) {
    std::vector<std::string> known;
    for (const auto& [name, unused] : producers) known.push_back(name);
    throw UpgradeError("layers", index,
                       str("layer '", layer.layer().name(), "': no layer before it makes bottom '",
                           blob, "'", did_you_mean(blob, known)));
  }
  if (producer->second == kInput) return;
  const V1& source = net.layers(producer->second);
  if (source.layer().type() != kPadding) return;

  V0& v0 = *layer.mutable_layer();
  const auto reject = [&](const char* reason) {
    throw UpgradeError("layers", index,
                       str("layer '", v0.name(), "' (", v0.type(), ") after padding layer '",
                           source.layer().name(), "': ", reason));
  };
  if (v0.type() != "conv" && v0.type() != "pool")
    reject("only conv and pool can follow a padding layer");
  if (layer.bottom_size() != 1) reject("expected one bottom");
  if (source.bottom_size() != 1 || source.top_size() != 1) {
    reject("a padding layer needs one bottom and one top");
  }
  if (v0.pad() != 0) {
    warnings.push_back(str("layer '", v0.name(), "': its own pad ", v0.pad(), " gives way to pad ",
                           source.layer().pad(), " of padding layer '", source.layer().name(),
                           "', as in Caffe"));
  }
  v0.set_pad(source.layer().pad());
  layer.set_bottom(j, source.bottom(0));
}

}  // namespace

void upgrade_v0(caffe::NetParameter& net, std::vector<std::string>& warnings) {
  if (std::ranges::none_of(net.layers(), [](const V1& layer) { return layer.has_layer(); })) return;

  Producers producers;
  for (const std::string& input : net.input()) producers[input] = kInput;
  google::protobuf::RepeatedPtrField<V1> upgraded;
  for (int i = 0; i < net.layers_size(); ++i) {
    if (!net.layers(i).has_layer()) {
      throw UpgradeError("layers", i,
                         "a V1 layer in a net that also has V0 layers (`layers { layer {`)");
    }
    V1 layer = net.layers(i);
    for (int j = 0; j < layer.bottom_size(); ++j)
      fold_padding(net, producers, i, j, layer, warnings);
    for (const std::string& top : layer.top()) producers[top] = i;
    if (layer.layer().type() != kPadding) *upgraded.Add() = upgrade_layer(layer, i, warnings);
  }
  *net.mutable_layers() = std::move(upgraded);
}

}  // namespace revisit::proto
