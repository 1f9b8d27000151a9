#pragma once

#include <memory>

#include "layer.h"

/// The factories behind the registry; one layer type a file. Each throws InputError for parameters
/// that are wrong whatever the input.
namespace revisit::engine {

using LayerFactory = std::unique_ptr<Layer>(const caffe::LayerParameter&);

LayerFactory make_concat;
LayerFactory make_convolution;
LayerFactory make_convolution_depthwise;
LayerFactory make_deconvolution;
LayerFactory make_depthwise_convolution;
LayerFactory make_detection_output;
LayerFactory make_filter;
LayerFactory make_flatten;
LayerFactory make_identity;  // Dropout (at inference), Split
LayerFactory make_im2col;
LayerFactory make_inner_product;
LayerFactory make_interp;
LayerFactory make_lrn;
LayerFactory make_lstm;
LayerFactory make_normalize;
LayerFactory make_pooling;
LayerFactory make_prior_box;
LayerFactory make_relu;
LayerFactory make_rnn;
LayerFactory make_roi_pooling;
LayerFactory make_softmax;
LayerFactory make_spp;
LayerFactory make_upsample;

}  // namespace revisit::engine
