#pragma once

#include <memory>

#include "layer.h"

/// The factories behind the registry; one layer type a file, but for those that share their code:
/// functions of one number are in elementwise.cpp. Each throws InputError for parameters that are
/// wrong whatever the input.
namespace revisit::engine {

using LayerFactory = std::unique_ptr<Layer>(const caffe::LayerParameter&);

LayerFactory make_abs_val;
LayerFactory make_accuracy;
LayerFactory make_argmax;
LayerFactory make_axpy;
LayerFactory make_batch_norm;
LayerFactory make_batch_reindex;
LayerFactory make_bias;
LayerFactory make_bn;
LayerFactory make_bnll;
LayerFactory make_clip;
LayerFactory make_concat;
LayerFactory make_convolution;
LayerFactory make_convolution_depthwise;
LayerFactory make_crop;
LayerFactory make_crop_center;
LayerFactory make_deconvolution;
LayerFactory make_depthwise_convolution;
LayerFactory make_detection_output;
LayerFactory make_dummy_data;
LayerFactory make_eltwise;
LayerFactory make_elu;
LayerFactory make_embed;
LayerFactory make_euclidean_loss;
LayerFactory make_exp;
LayerFactory make_filter;
LayerFactory make_flatten;
LayerFactory make_identity;  // Dropout (at inference), Split
LayerFactory make_im2col;
LayerFactory make_inner_product;
LayerFactory make_interp;
LayerFactory make_log;
LayerFactory make_lrn;
LayerFactory make_lstm;
LayerFactory make_mvn;
LayerFactory make_normalize;
LayerFactory make_parameter;
LayerFactory make_permute;
LayerFactory make_pooling;
LayerFactory make_power;
LayerFactory make_prelu;
LayerFactory make_prior_box;
LayerFactory make_reduction;
LayerFactory make_relu6;
LayerFactory make_relu;
LayerFactory make_reshape;
LayerFactory make_rnn;
LayerFactory make_roi_pooling;
LayerFactory make_scale;
LayerFactory make_shuffle_channel;
LayerFactory make_sigmoid;
LayerFactory make_silence;
LayerFactory make_slice;
LayerFactory make_softmax;
LayerFactory make_softmax_with_loss;
LayerFactory make_spp;
LayerFactory make_swish;
LayerFactory make_tanh;
LayerFactory make_threshold;
LayerFactory make_tile;
LayerFactory make_upsample;

}  // namespace revisit::engine
