#pragma once

#include <memory>

#include "layer.h"
#include "revisit/engine/net.h"

namespace revisit::engine {

/// Each factory throws InputError for parameters that are invalid for any input.
using LayerFactory = std::unique_ptr<Layer>(const caffe::LayerParameter&);

LayerFactory make_abs_val, make_accuracy, make_argmax, make_axpy, make_batch_norm,
    make_batch_reindex, make_bias, make_bn, make_bnll, make_box_group_output, make_box_output,
    make_clip, make_concat, make_convolution, make_convolution_depthwise, make_crop,
    make_crop_center, make_decode_bbox, make_deconvolution, make_depthwise_convolution,
    make_detection_output, make_dropout, make_dummy_data, make_eltwise, make_elu, make_embed,
    make_euclidean_loss, make_exp, make_filter, make_flatten, make_flip, make_identity, make_im2col,
    make_inner_product, make_interp, make_log, make_lrn, make_lstm, make_mish, make_mvn,
    make_normalize, make_parameter, make_permute, make_pooling, make_power, make_prelu,
    make_prior_box, make_prior_box_clustered, make_proposal, make_psroi_pooling, make_reduction,
    make_relu, make_relu6, make_reorg, make_reshape, make_reverse, make_rnn, make_roi_align,
    make_roi_pooling, make_rows_lstm, make_scale, make_shuffle_channel, make_sigmoid, make_silence,
    make_slice, make_softmax, make_softmax_with_loss, make_spp, make_swish, make_tanh,
    make_threshold, make_tile, make_transpose, make_upsample, make_yolo_detection_output,
    make_yolov3_detection_output;

/// Not in the registry: values of the first input with the shape of the second.
LayerFactory make_reshaped_like;

/// Type of net inputs, for which the engine has no layer.
constexpr const char* kInputType = "Input";

bool is_supported(const std::string& type);

/// Throws UnsupportedError with a fix for a type that `make_layer()` does not support.
void check_type(const caffe::LayerParameter& param);

/// Creates the layer of type `param.type()`; null for kInputType. Throws UnsupportedError for an
/// unknown type, InputError for invalid parameters.
std::unique_ptr<Layer> make_layer(const caffe::LayerParameter& param);

/// Returns the chosen interpretation and the fork with a different one, if the file cannot show
/// which fork's layer type it means; "" for all other layers.
std::string ambiguity_of(const caffe::LayerParameter& param);

}  // namespace revisit::engine
