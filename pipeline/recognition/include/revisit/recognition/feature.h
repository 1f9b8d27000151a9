#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <variant>

#include "revisit/engine/net.h"
#include "revisit/recognition/align.h"
#include "revisit/recognition/calibration.h"
#include "revisit/recognition/comparison.h"
#include "revisit/recognition/feature_file.h"
#include "revisit/recognition/gray_image.h"
#include "revisit/recognition/range_image.h"

namespace revisit::pipeline {

/// Writes the feature of one input; the span has FeatureExtractor::dim floats.
template <class Input>
using FeatureFunction = std::function<void(const Input&, std::span<float>)>;
/// Makes a function with its own working memory: one per thread.
template <class Input>
using FeatureMaker = std::function<FeatureFunction<Input>()>;

/// What was learnt from features: how one becomes a descriptor, and how two of these are compared.
struct Basis {
  int64_t dim = 0;  // numbers of a descriptor
  std::function<void(std::span<const float> feature, std::span<float> descriptor)> describe;
  Comparison comparison;
  std::string content;  // FeatureExtractor::open_basis() makes the same of it
};
/// Learns from the rows `learn_from` of some features.
using Reduction = std::function<Basis(const Rows& features, std::span<const int64_t> learn_from)>;

/// A way to turn scans into feature vectors.
struct FeatureExtractor {
  std::string name;  // for people and plots: "conv3+pool5", "data"
  std::string key;   // names everything the values depend on besides the input
  int64_t dim = 0;
  /// Input of the feature: range image of the aligned points, the aligned points, or camera image.
  std::variant<FeatureMaker<RangeImage>, FeatureMaker<PointCloud>, FeatureMaker<GrayImage>> make;
  Comparison comparison;  // of two of them, or of what `reduce` makes of them
  Reduction reduce;       // into descriptors; empty: by PCA, or not at all
  std::function<Basis(const std::string& content)> open_basis;  // one that `reduce` made
  /// A match is scored by the best similarity alone, a probability, instead of Score::kMargin.
  bool best_is_sure = false;
  std::optional<Calibration> calibration;  // of its matches, where one is known

  template <class Input>
  bool sees() const {
    return std::holds_alternative<FeatureMaker<Input>>(make);
  }
};

struct Forward {
  int threads = 1;  // of one pass
  engine::Precision precision = engine::Precision::kFloat32;
};

/// The output of a network, flattened. Every input channel gets the gray image minus that channel's
/// mean (`mean_bgr`, in pixel values; paper section III-C; a net of one channel gets that of the
/// gray image, 0.114 B + 0.587 G + 0.299 R), times `input_scale`. A first convolution gets it once,
/// for all channels. `net_key` identifies the weights. Throws InputError when the net has not one
/// input of 1 or 3 channels, or cannot take the size; UsageError when it has not just one output.
FeatureExtractor network_features(const engine::Net& net, const std::string& net_key,
                                  const std::array<double, 3>& mean_bgr,
                                  const ImageGeometry& geometry, const Forward& forward = {},
                                  double input_scale = 1);

/// The range image itself as a vector: the paper's `data`, for comparison.
FeatureExtractor range_vector_features(const ImageGeometry& geometry);

/// From a scan to its feature: aligned and, if the feature sees the range image, projected, holes
/// closed. Throws InputError for a scan that cannot be aligned, UsageError for camera images.
FeatureFunction<PointCloud> from_scan(const FeatureExtractor& extractor, AlignCase align,
                                      const ImageGeometry& geometry);

/// The range image the features see: aligned, projected, holes closed.
RangeImage scan_to_image(const PointCloud& cloud, AlignCase mode, const ImageGeometry& geometry);

}  // namespace revisit::pipeline
