#pragma once

#include "caffe_schema.pb.h"

namespace revisit::engine {

/// NVIDIA's BatchNorm with five blobs: a fourth that scales and a fifth that shifts.
inline bool has_scale_and_bias(const caffe::BatchNormParameter& param) {
  return param.scale_bias() || param.has_scale_filler() || param.has_bias_filler();
}

/// SegNet's BN has scale and shift; PSPNet's has slope, bias, mean and variance.
inline bool is_of_segnet(const caffe::BNParameter& param) {
  return param.has_scale_filler() || param.has_shift_filler() || param.has_bn_mode();
}

}  // namespace revisit::engine
