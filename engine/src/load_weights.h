#pragma once

#include <cstdint>
#include <memory>

#include "net_impl.h"
#include "revisit/proto/weights_file.h"

namespace revisit::engine {

/// Returns the parameter name of a blob of `node`; "" if it cannot be shared.
std::string parameter_of(const Node& node, size_t blob);

/// Finds shared blobs (`param { name: "..." }`) over all layers of the file.
Sharing find_sharing(const caffe::NetParameter& file);

OwnShared find_own_shared(const caffe::NetParameter& file);

bool has_own_weights(const Net::Impl& net);

/// Throws InputError unless shared blobs of kept layers have equal shapes, or equal numbers of
/// elements with `share_mode: PERMISSIVE`.
void check_sharing(const Net::Impl& net);

/// Sets weights from the prototxt itself, then from the file, if any. The file's layers match by
/// name over all layers of the net, as in Caffe (docs/LAYERS.md point 9). Shared blobs take the
/// weights of any layer of their group. Throws InputError with layer, blob, expected and found
/// shapes, and for missing weights unless allowed.
void load_weights(Net::Impl& net, std::unique_ptr<proto::WeightsFile> weights,
                  const LoadOptions& options);

/// Draws weights from Gaussians with mean 0 and variance 2 / (inputs per output) (He et al. 2015),
/// so that values keep their size from layer to layer. Biases are uniform in [-0.01, 0.01), factors
/// and variances in [0.9, 1.1).
///
/// Value i of blob b of the file's layer l depends only on (seed, l, b, i), by the finalizer of
/// SplitMix64 (Steele et al. 2014). A Gaussian is the sum of 12 uniform 32-bit integers
/// (Irwin-Hall: variance exactly 1, support +-6) without libm, so the bits are equal on all
/// platforms.
void fill_randomly(Net::Impl& net, uint64_t seed);

}  // namespace revisit::engine
