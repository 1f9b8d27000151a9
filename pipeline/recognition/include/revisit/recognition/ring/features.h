#pragma once

#include "revisit/engine/net.h"
#include "revisit/recognition/feature.h"
#include "revisit/recognition/ring/describe.h"
#include "revisit/recognition/ring/model.h"

namespace revisit::pipeline {

/// The image rings are taken from: 1024 columns, a row a beam, at most 64, and small holes closed.
/// Throws UsageError for an unknown sensor.
ImageGeometry ring_geometry(const std::string& sensor);

/// The net of a model: its own, or from the weights file given. Cut off behind the model's layers.
/// Throws InputError when the model has no weights and no file is given, or what Net::load throws.
engine::Net ring_net(const RingModel& model, const std::filesystem::path& weights = {});

/// Features of a model's scans whose reduction learns the ring mean (and with options.adapt the
/// spread) from the scans it is given. Throws UsageError for invalid options.
FeatureExtractor ring_recogniser(const RingModel& model, const engine::Net& net,
                                 const RingOptions& options, const Forward& forward = {});

/// Both rings of a scan and their weights, RingModel::dim() floats, from its points in the sensor
/// frame, levelled by the ground. The range image is continued by an eighth of a turn on both
/// sides, which keeps the net's padding away. Throws InputError when the net does not take the
/// image, has no such layer, or a layer's columns do not divide the image evenly.
FeatureExtractor ring_features(const RingModel& model, const engine::Net& net,
                               const Forward& forward = {});

}  // namespace revisit::pipeline
