#pragma once

#include "revisit/recognition/ring/descriptor.h"

namespace revisit::fuzz {

/// Ring descriptors of 32 dimensions, by a net that runs in microseconds, without training.
inline RingModel small_ring_model() {
  RingModel model;
  model.image.width = 16;
  model.image.height = 4;
  model.prototxt = R"(
layer { name: "data" type: "Input" top: "data"
        input_param { shape { dim: 1 dim: 1 dim: 4 dim: 16 } } }
layer { name: "pool" type: "Pooling" bottom: "data" top: "pool"
        pooling_param { pool: AVE kernel_h: 4 kernel_w: 1 } })";
  model.weights = "\xa2\6\3\n\1p";
  RingLayer& layer = model.layers.emplace_back();
  layer.name = "pool";
  layer.mean = {0};
  layer.directions = FloatMatrix(1, 1);
  layer.directions.values = {1};
  model.grid = {.sectors = 4, .distances = {0, 10, 40}, .bands = {}};
  model.cnn = {.sectors = 8, .features = 1};
  model.polar = {.sectors = 4, .features = 2, .weights = 2, .mirrored = true};
  for (RingStatistics* ring : {&model.cnn, &model.polar}) {
    ring->mean.resize(static_cast<size_t>(ring->size()));
    ring->total.assign(17, Eigen::MatrixXcd::Identity(ring->features, ring->features));
  }
  return model;
}

inline FeatureExtractor small_rings() {
  const RingModel model = small_ring_model();
  return ring_recognizer(model, ring_net(model), {.dim = 16});
}

}  // namespace revisit::fuzz
