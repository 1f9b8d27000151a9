#pragma once

#include "revisit/engine/net.h"
#include "revisit/recognition/feature.h"
#include "revisit/recognition/ring/describe.h"
#include "revisit/recognition/ring/model.h"

namespace revisit {

/// Geometry of the range image for rings: 1024 columns, one row per beam (at most 64), small holes
/// closed. Throws UsageError for an unknown sensor.
ImageGeometry ring_geometry(const std::string& sensor);

/// Loads the net of a model, from the model itself or from the given weights file, truncated after
/// the model's last layer. Throws InputError if the model has no weights and no file is given, and
/// what Net::load throws.
engine::Net ring_net(const RingModel& model, const std::filesystem::path& weights = {});

/// Extracts ring_features(); the reduction projects them to descriptors (RingDescriber). It
/// estimates the map mean, and with options.blend the covariance, from the scans it is given.
/// Throws UsageError for invalid options.
FeatureExtractor ring_recognizer(const RingModel& model, const engine::Net& net,
                                 const RingOptions& options, const Forward& forward = {});

/// Extracts both ring descriptors of a scan and their weights, RingModel::dim() floats, from points
/// in the sensor frame. The scan is gravity-aligned by its ground. The range image is continued by
/// an eighth of its width on both sides, because this keeps the net's padding away from the rings.
/// Throws InputError if the net cannot process the image, has no such layer, or a layer's columns
/// do not divide the image evenly.
FeatureExtractor ring_features(const RingModel& model, const engine::Net& net,
                               const Forward& forward = {});

}  // namespace revisit
