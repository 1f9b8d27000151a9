#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>

#include "layers/batch_norm.h"
#include "net_impl.h"
#include "revisit/base/hash.h"

namespace revisit::engine {
namespace {

/// Returns whether values of a weight blob must be around 1: variances of BatchNorm (blob 1; blob 2
/// divides both sums; blob 3 scales), factors of Scale and Normalize, factors and variances of BN.
bool is_around_one(const std::string& type, size_t blob) {
  return (type == "BatchNorm" && blob > 0 && blob < 4) ||
         (type == "BN" && (blob == 0 || blob == 3)) ||
         ((type == "Scale" || type == "Normalize") && blob == 0);
}

/// Random numbers of one blob: number i does not depend on earlier calls.
class WeightNumbers {
 public:
  WeightNumbers(uint64_t seed, uint64_t layer, uint64_t blob)
      : key_(mixed_bits(mixed_bits(seed + kSplitmixStep) + layer * kSplitmixStep + blob)) {}

  /// Gaussian of variance 1 (mean 12 * (2^32 - 1) / 2, units of 2^32); exact in double.
  double gaussian(uint64_t i) const {
    int64_t sum = 0;
    for (uint64_t j = 0; j < 6; ++j) {
      const uint64_t bits = word(6 * i + j);
      sum += static_cast<int64_t>(bits >> 32) + static_cast<int64_t>(bits & 0xFFFFFFFF);
    }
    constexpr int64_t kMean = 6 * ((int64_t{1} << 32) - 1);
    return std::ldexp(static_cast<double>(sum - kMean), -32);
  }

  /// Uniform in [-1, 1); exact in double.
  double uniform(uint64_t i) const {
    return std::ldexp(static_cast<double>(word(i) >> 12), -51) - 1;
  }

 private:
  uint64_t word(uint64_t i) const { return mixed_bits(key_ + (i + 1) * kSplitmixStep); }

  uint64_t key_;
};

void fill_blob(const std::string& type, size_t blob, const WeightNumbers& numbers, Tensor& weight) {
  weight.values.resize(weight.shape.elements());
  const size_t rank = weight.shape.rank();
  const bool is_summed = rank > 1 && type != "BN";
  const double fan_in = is_summed ? static_cast<double>(weight.shape.product(1, rank)) : 1;
  const double sigma = std::sqrt(2 / fan_in);
  const bool around_one = is_around_one(type, blob);
  uint64_t i = 0;
  for (float& value : weight.values) {
    const double number = is_summed    ? sigma * numbers.gaussian(i)
                          : around_one ? 1 + 0.1 * numbers.uniform(i)
                                       : 0.01 * numbers.uniform(i);
    value = static_cast<float>(number);
    ++i;
  }
}

using Filler = caffe::FillerParameter;

/// Inputs or outputs of a unit, or their mean, as Caffe counts them.
double fan_of(const Filler& filler, const Shape& shape) {
  const auto count = static_cast<double>(shape.elements());
  const double in = shape.rank() > 0 ? count / static_cast<double>(shape[0]) : count;
  const double out = shape.rank() > 1 ? count / static_cast<double>(shape[1]) : count;
  if (filler.variance_norm() == Filler::AVERAGE) return (in + out) / 2;
  return filler.variance_norm() == Filler::FAN_OUT ? out : in;
}

void fill_bilinear(const Shape& shape, std::vector<float>& values) {
  if (shape.rank() != 4 || shape[2] != shape[3])
    throw InputError("filler 'bilinear': expected a square kernel of 4 axes, found ", shape);
  const int64_t size = shape[3];
  const double half = std::ceil(static_cast<double>(size) / 2);
  const double center = static_cast<double>(size - 1) / (2 * half);
  const auto weight = [&](int64_t i) {
    return 1 - std::abs(static_cast<double>(i) / half - center);
  };
  for (size_t i = 0; i < values.size(); ++i) {
    const auto at = static_cast<int64_t>(i);
    values[i] = static_cast<float>(weight(at % size) * weight(at / size % size));
  }
}

/// Divides each row by its sum.
void normalize_rows(const Shape& shape, std::vector<float>& values) {
  const size_t rows = shape.rank() > 0 ? static_cast<size_t>(shape[0]) : 1;
  for (size_t row = 0, width = rows > 0 ? values.size() / rows : 0; row < rows; ++row) {
    const auto begin = values.begin() + static_cast<int64_t>(row * width);
    const float sum = std::accumulate(begin, begin + static_cast<int64_t>(width), 0.0F);
    std::transform(begin, begin + static_cast<int64_t>(width), begin,
                   [sum](float value) { return value / sum; });
  }
}

/// Fields of a layer's parameters that hold the fillers of its weights and of its biases, and the
/// constant of weights without a filler.
struct LayerFillers {
  const char *type, *message, *weight, *bias;
  float absent;
};
constexpr std::array<LayerFillers, 13> kFillers = {{
    {"BatchNorm", "batch_norm_param", "scale_filler", "bias_filler", 1},
    {"Bias", "bias_param", "filler", "filler", 0},
    {"Convolution", "convolution_param", "weight_filler", "bias_filler", 0},
    {"ConvolutionDepthwise", "convolution_param", "weight_filler", "bias_filler", 0},
    {"Deconvolution", "convolution_param", "weight_filler", "bias_filler", 0},
    {"DepthwiseConvolution", "convolution_param", "weight_filler", "bias_filler", 0},
    {"Embed", "embed_param", "weight_filler", "bias_filler", 0},
    {"InnerProduct", "inner_product_param", "weight_filler", "bias_filler", 0},
    {"LSTM", "recurrent_param", "weight_filler", "bias_filler", 0},
    {"Normalize", "norm_param", "scale_filler", "scale_filler", 1},
    {"PReLU", "prelu_param", "filler", "filler", 0.25F},
    {"RNN", "recurrent_param", "weight_filler", "bias_filler", 0},
    {"Scale", "scale_param", "filler", "bias_filler", 1},
}};

Filler constant(float value) {
  Filler filler;
  filler.set_value(value);
  return filler;
}

Filler filler_of_bn(const caffe::BNParameter& bn, size_t blob) {
  if (blob > 1) return constant(blob == 3 && bn.frozen() ? 1 : 0);
  if (is_of_segnet(bn)) return blob == 0 ? bn.scale_filler() : bn.shift_filler();
  return blob == 0 ? bn.slope_filler() : bn.bias_filler();
}

Filler filler_of(const caffe::LayerParameter& layer, size_t blob, const Shape& shape) {
  const std::string& type = layer.type();
  if (type == "BN") return filler_of_bn(layer.bn_param(), blob);
  if (type == "BatchNorm" && blob < 3)
    return constant(blob == 2 && has_scale_and_bias(layer.batch_norm_param()) ? 1 : 0);
  const auto* found = std::ranges::find(kFillers, type, &LayerFillers::type);
  if (found == kFillers.end()) return constant(0);
  const LayerFillers& fillers = *found;
  const bool is_recurrent = type == "LSTM" || type == "RNN";  // biases are between matrices
  const bool is_bias = is_recurrent ? shape.rank() == 1 : blob > (type == "BatchNorm" ? 3 : 0);
  const auto* param_field = layer.GetDescriptor()->FindFieldByName(fillers.message);
  const auto& param = layer.GetReflection()->GetMessage(layer, param_field);
  const auto* field =
      param.GetDescriptor()->FindFieldByName(is_bias ? fillers.bias : fillers.weight);
  if (!is_bias && !param.GetReflection()->HasField(param, field)) return constant(fillers.absent);
  Filler filler;
  filler.CopyFrom(param.GetReflection()->GetMessage(param, field));
  return filler;
}

}  // namespace

std::vector<float> filled(const Filler& filler, const Shape& shape, uint64_t seed) {
  std::vector<float> values(static_cast<size_t>(shape.elements()), filler.value());
  const std::string& type = filler.type();
  const WeightNumbers numbers(seed, 0, 0), other_numbers(seed, 0, 1);
  const auto draw = [&](const auto& number) {
    for (uint64_t i = 0; i < values.size(); ++i) values[i] = static_cast<float>(number(i));
  };
  const auto uniform = [&](double low, double high) {
    draw([&, low, high](uint64_t i) { return low + (high - low) * (numbers.uniform(i) + 1) / 2; });
  };
  const auto gaussian = [&](double mean, double deviation) {
    draw([&, mean, deviation](uint64_t i) { return mean + deviation * numbers.gaussian(i); });
  };
  if (type == "constant") return values;
  if (type == "uniform") {
    uniform(filler.min(), filler.max());
  } else if (type == "gaussian") {
    gaussian(filler.mean(), filler.std());
    const double kept = filler.sparse() < 0 || shape.rank() == 0
                            ? 1
                            : static_cast<double>(filler.sparse()) / static_cast<double>(shape[0]);
    for (uint64_t i = 0; kept < 1 && i < values.size(); ++i)
      if (!((other_numbers.uniform(i) + 1) / 2 < kept)) values[i] = 0;
  } else if (type == "positive_unitball") {
    uniform(0, 1);
    normalize_rows(shape, values);
  } else if (type == "xavier") {
    const double scale = std::sqrt(3 / fan_of(filler, shape));
    uniform(-scale, scale);
  } else if (type == "msra") {
    gaussian(0, std::sqrt(2 / fan_of(filler, shape)));
  } else if (type == "bilinear") {
    fill_bilinear(shape, values);
  } else {
    throw InputError(
        "filler: expected one of constant, uniform, gaussian, positive_unitball, "
        "xavier, msra, bilinear, found '",
        type, "'");
  }
  return values;
}

std::vector<float> filled(std::string_view filler, const Shape& shape, uint64_t seed) {
  Filler message;
  if (!message.ParseFromArray(filler.data(), static_cast<int>(filler.size())))
    throw InputError("filler: expected a serialized FillerParameter");
  return filled(message, shape, seed);
}

std::vector<float> initial_weights(const caffe::LayerParameter& layer, size_t blob,
                                   const Shape& shape, uint64_t seed) {
  return filled(filler_of(layer, blob, shape), shape, seed + blob);
}

void fill_randomly(Net::Impl& net, uint64_t seed) {
  std::map<std::string, const Tensor*> first_blob_of_group;
  for (Node& node : net.graph.nodes) {
    for (size_t blob = 0; blob < node.weights->size(); ++blob) {
      Tensor& weight = (*node.weights)[blob];
      if (const std::string group = parameter_of(node, blob); !group.empty()) {
        const auto [first, is_new] = first_blob_of_group.try_emplace(group, &weight);
        if (!is_new) {
          weight.values = first->second->values;
          continue;
        }
      }
      fill_blob(node.param.type(), blob, {seed, static_cast<uint64_t>(node.index), blob}, weight);
    }
  }
  net.has_weights = true;
}

}  // namespace revisit::engine
