#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "revisit/engine/net.h"
#include "revisit/recognition/feature.h"
#include "revisit/recognition/match.h"
#include "revisit/recognition/ring/model.h"

namespace revisit {

/// Layout of a descriptor: number of complex coefficients, frequency by frequency; first the real
/// parts, then (except for frequency 0) the imaginary parts.
using RingLayout = std::vector<int>;
/// Dimensions of a descriptor.
int64_t dim_of(const RingLayout& layout);

/// Compares a query with many places by the maximum of the circular correlation over 360 yaw angles
/// (docs/reference/METHODS.md, eq. 6). The similarity is 0 for a zero descriptor.
/// Candidates may be preselected by compact codes: 128 complex coefficients of a descriptor, one
/// byte each, compared at 32 yaw angles. Throws UsageError for more frequencies than rings have.
Comparison ring_comparison(const RingLayout& layout, int64_t candidates = 0);

/// Settings of ring descriptors.
struct RingOptions {
  int dim = 1024;  ///< dimensions of a descriptor, half of them for each ring
  /// Added to the total covariance, in units of its mean eigenvalue. A larger value gives
  /// directions of small variance less weight.
  double regularization = 1e-2;
  double blend = 0.3;  ///< see fit_to_map()
  /// Number of candidates compared exactly, preselected by compact codes (match.h); 0: all.
  int64_t candidates = 0;
};

/// Projects the ring descriptors of a scan, a feature of ring_features(), to the vector that is
/// stored and compared. Where something was seen, the map mean is subtracted. Each frequency is
/// projected onto directions that agree only between scans of one place (LDA,
/// docs/reference/METHODS.md). RingModel::cnn_weight weights the two rings. The length is 1; parts
/// that were not seen contribute 0. `model` must be fitted to the map by fit_to_map(). Throws
/// UsageError for invalid options.
Projection ring_projection(const RingModel& model, const RingOptions& options = {});

/// Geometry of the range image for rings: 1024 columns, one row per beam (at most 64), small holes
/// closed. Throws UsageError for an unknown sensor.
ImageGeometry ring_geometry(const std::string& sensor);

/// Loads the net of a model, from the model itself or from the given weights file, truncated after
/// the model's last layer. Throws InputError if the model has no weights and no file is given, and
/// what Net::load throws.
engine::Net ring_net(const RingModel& model, const std::filesystem::path& weights = {});

/// Extracts ring_features(); the reduction projects them to descriptors (ring_projection()). It
/// estimates the map mean, and with options.blend the covariance, from the scans it is given.
/// Throws UsageError for invalid options.
FeatureExtractor ring_recognizer(const RingModel& model, const engine::Net& net,
                                 const RingOptions& options,
                                 const engine::PlanOptions& forward = {});

/// Extracts both ring descriptors of a scan and their weights, RingModel::dim() floats, from points
/// in the sensor frame. The scan is gravity-aligned by its ground. The range image is continued by
/// an eighth of its width on both sides, because this keeps the net's padding away from the rings.
/// Throws InputError if the net cannot process the image, has no such layer, or a layer's columns
/// do not divide the image evenly.
FeatureExtractor ring_features(const RingModel& model, const engine::Net& net,
                               const engine::PlanOptions& forward = {});

}  // namespace revisit
