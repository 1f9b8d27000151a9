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

/// The features of a model's scans and how they become descriptors: ring_features() learns the ring
/// mean (and with options.adapt the spread) from the scans it is told to. Throws UsageError for
/// invalid options.
FeatureExtractor ring_recogniser(const RingModel& model, const engine::Net& net,
                                 const RingOptions& options, const Forward& forward = {});

/// Both rings of a scan and their weights, RingModel::dim() floats, from its points in the sensor
/// frame. The scan is levelled first, by the ground that it shows. The range image is continued by
/// an eighth of a turn on both sides, so that the net's padding is far from what is kept. Throws
/// InputError when the net does not take the image or has no such layer, or a layer's columns do
/// not divide the image evenly.
FeatureExtractor ring_features(const RingModel& model, const engine::Net& net,
                               const Forward& forward = {});

}  // namespace revisit::pipeline
