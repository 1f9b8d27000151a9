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
#include "revisit/recognition/feature_file.h"
#include "revisit/recognition/match.h"
#include "revisit/recognition/range_image.h"

namespace revisit {

/// Writes the feature of one input; the span has FeatureExtractor::dim floats.
template <class Input>
using FeatureFunction = std::function<void(const Input&, std::span<float>)>;
/// Makes a function with its own working memory; each thread needs its own.
template <class Input>
using FeatureMaker = std::function<FeatureFunction<Input>()>;

/// Descriptor projection estimated from features, and the comparison of descriptors.
struct Projection {
  int64_t dim = 0;  ///< dimensions of a descriptor
  /// Projects a feature to a descriptor [dim].
  std::function<void(std::span<const float> feature, std::span<float> descriptor)> describe;
  Comparison comparison;  ///< of descriptors
  std::string content;    ///< serialized form, for FeatureExtractor::open_projection()
};
/// Estimates a projection from the rows `fit_rows` of some features.
using FitProjection =
    std::function<Projection(const Rows& features, std::span<const int64_t> fit_rows)>;

/// A method that computes features of scans or images.
struct FeatureExtractor {
  std::string name;  ///< human-readable: "conv3+pool5", "data"
  std::string key;   ///< identifies everything that the values depend on besides the input
  int64_t dim = 0;   ///< floats of a feature
  /// Input of the feature: range image of the aligned points, aligned points, or camera image.
  std::variant<FeatureMaker<RangeImage>, FeatureMaker<PointCloud>, FeatureMaker<GrayImage>> make;
  Comparison comparison;         ///< features, or descriptors if `fit_projection` is set
  FitProjection fit_projection;  ///< to descriptors; empty: PCA or none
  std::function<Projection(const std::string& content)>
      open_projection;  ///< reads Projection::content
  /// Scores a match by the best similarity, a probability, instead of by Score::kMargin.
  bool similarity_is_probability = false;
  std::optional<Calibration> calibration;  ///< of its scores; absent: none is known

  /// The input is of this type.
  template <class Input>
  bool sees() const {
    return std::holds_alternative<FeatureMaker<Input>>(make);
  }
};

/// Extracts the flattened output of a network. Each input channel is (gray image - channel mean) *
/// `input_scale`. The means are `mean_bgr`, in pixel values (paper, section III-C); a net with one
/// channel uses 0.114 B + 0.587 G + 0.299 R. A first convolution processes the replicated channel
/// only once. `net_key` identifies the weights. `forward`: threads per pass and precision; its
/// other members are ignored, here and for rings. Throws InputError unless the net has one input of
/// 1 or 3 channels and accepts the size; UsageError unless it has one output.
FeatureExtractor network_features(const engine::Net& net, const std::string& net_key,
                                  const std::array<double, 3>& mean_bgr,
                                  const ImageGeometry& geometry,
                                  const engine::PlanOptions& forward = {}, double input_scale = 1);

/// Extracts the range image itself as a vector: the paper's `data` feature.
FeatureExtractor range_vector_features(const ImageGeometry& geometry);

/// Extracts a feature from a scan: aligns it and, if the feature sees range images, projects it and
/// closes holes. Throws InputError for a scan that cannot be aligned, UsageError for camera images.
FeatureFunction<PointCloud> from_scan(const FeatureExtractor& extractor, AlignCase align,
                                      const ImageGeometry& geometry);

/// Aligned, projected, holes closed.
RangeImage scan_to_image(const PointCloud& cloud, AlignCase mode, const ImageGeometry& geometry);

}  // namespace revisit
