#pragma once

#include "kernels/blocked/convolution_max_pool.h"
#include "kernels/blocked/lrn_squares.h"
#include "kernels/blocked/plain_input_scratch.h"
#include "kernels/blocked/pooling_pieces.h"

namespace revisit::engine {

inline PoolingPieces pieces_of(const ConvolutionMaxPool& p) {
  return {p.pooling, p.convolution.c_out, p.convolution.threads};
}

/// Scratch of one thread in addition to that of the pieces, consecutively.
struct ConvolutionMaxPoolScratch {
  int64_t patch, columns, squares;

  explicit ConvolutionMaxPoolScratch(const ConvolutionMaxPool& p)
      : patch(padded_channels(plain_input_patch_floats(p.convolution))),
        columns(p.in_tiles ? plain_input_columns_floats(p.convolution) : 0),
        squares(p.lrn ? LrnSquares(*p.lrn).floats() : 0) {}

  int64_t floats() const { return patch + columns + squares; }
};

}  // namespace revisit::engine
