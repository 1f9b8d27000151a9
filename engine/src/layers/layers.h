#pragma once

#include <initializer_list>
#include <memory>
#include <type_traits>

#include "kernels/nchw.h"
#include "layer.h"
#include "revisit/engine/net.h"

namespace revisit::engine {

/// A layer type.
struct LayerEntry {
  const char* type;
  /// Throws InputError for parameters that are invalid for any input.
  std::unique_ptr<Layer> (*make)(const caffe::LayerParameter&);
  const char* origin;  // LayerType::origin
  const char* does;
  bool has_weights = false;
  const char* other_forks = nullptr;  // set if the file cannot show which fork's layer it means
};
constexpr bool kTrained = true;

using Parameters = caffe::LayerParameter;

/// LayerEntry::make of a class that is constructed from the message `kMessage` and `kMore`, or else
/// from all parameters, if it takes any.
template <class L, auto kMessage = nullptr, auto... kMore>
std::unique_ptr<Layer> make(const Parameters& param) {
  if constexpr (std::is_member_function_pointer_v<decltype(kMessage)>)
    return std::make_unique<L>((param.*kMessage)(), kMore...);
  else if constexpr (std::is_constructible_v<L, const Parameters&>)
    return std::make_unique<L>(param);
  else
    return std::make_unique<L>();
}

using LayerEntries = std::initializer_list<LayerEntry>;

/// The layer types of each file.
extern const LayerEntries kBatchNormLayers, kBoxOutputLayers, kConvolutionLayers, kDummyDataLayers,
    kElementwiseLayers, kInnerProductLayers, kJoinAndCutLayers, kLabelsLayers, kNormalizeLayers,
    kPermuteLayers, kPoolingLayers, kProposalLayers, kRecurrentLayers, kReductionLayers,
    kReshapeLayers, kResizeLayers, kRoiPoolingLayers, kRowsLayers, kScaleLayers, kSequencesLayers,
    kSsdLayers, kYoloDetectionOutputLayers;

std::unique_ptr<Layer> make_identity(const caffe::LayerParameter& param);

/// Not in the registry: values of the first input with the shape of the second.
std::unique_ptr<Layer> make_reshaped_like();

/// Type of net inputs, for which the engine has no layer.
constexpr const char* kInputType = "Input";

bool is_supported(const std::string& type);

/// Throws UnsupportedError with a fix for a type that `make_layer()` does not support.
void check_type(const caffe::LayerParameter& param);

/// Creates the layer of type `param.type()`; null for kInputType. Throws UnsupportedError for an
/// unknown type, InputError for invalid parameters.
std::unique_ptr<Layer> make_layer(const caffe::LayerParameter& param);

/// Returns the chosen interpretation and the fork with a different one, if the file cannot show
/// which fork's layer type it means; "" for all other layers.
std::string ambiguity_of(const caffe::LayerParameter& param);

// Shared by files of layers.

// Kernels that copy. Joining and cutting along an axis support values of any layout.
Kernel copy_kernel(const char* name, StridedCopyProblem copy);

/// Concatenates the inputs `outer` times; `sizes` has the floats of each.
Kernel join_kernel(int64_t outer, const std::vector<int64_t>& sizes);

/// Inverse of join_kernel().
Kernel cut_kernel(int64_t outer, const std::vector<int64_t>& sizes, int threads);

/// Takes `num_axes` axes of the input from `axis`; -1: all that follow.
Shape trained_operand(const Shape& input, int64_t axis, int64_t num_axes);

/// Maps `operand` to `input`, with its first axis at `axis`. A scalar matches any axis.
AxisRuns lay_over(const Shape& operand, const Shape& input, int64_t axis);

/// Returns x * scale + shift as ChannelAffine if `runs` assigns one number to each channel of
/// `input` (or to all); `scale` or `shift` can be null. Returns an empty form for other runs, and
/// for numbers that are not finite, because fused factors would change the results.
Form channel_affine(const AxisRuns& runs, const Shape& input, const std::vector<float>* scale,
                    const std::vector<float>* shift);

bool all_finite(const ChannelAffine& affine);

}  // namespace revisit::engine
