#pragma once

#include <memory>

#include "layer.h"

/// The factories behind the registry; one layer type a file. Each throws InputError for parameters
/// that are wrong whatever the input.
namespace revisit::engine {

using LayerFactory = std::unique_ptr<Layer>(const caffe::LayerParameter&);

LayerFactory make_concat;
LayerFactory make_convolution;
LayerFactory make_flatten;
LayerFactory make_identity;  // Dropout (at inference), Split
LayerFactory make_inner_product;
LayerFactory make_lrn;
LayerFactory make_pooling;
LayerFactory make_relu;
LayerFactory make_softmax;

}  // namespace revisit::engine
