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

/// Draws weights uniformly with the variance of He et al. 2015, which preserves the scale of
/// activations over depth.
void fill_randomly(Net::Impl& net, uint64_t seed);

}  // namespace revisit::engine
