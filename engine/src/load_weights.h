#pragma once

#include <cstdint>
#include <memory>

#include "net_impl.h"
#include "revisit/proto/weights_file.h"

namespace revisit::engine {

/// The name of the parameter that a blob of `node` is; empty when no other layer can share it.
std::string parameter_of(const Node& node, size_t blob);

/// Blobs that are one and the same (`param { name: "..." }`), over all layers of the file.
Sharing find_sharing(const Graph& whole);

OwnShared find_own_shared(const Graph& whole);

/// Whether the prototxt itself has all weights, so that no file is needed.
bool has_own_weights(const Net::Impl& net);

/// Throws InputError unless shared blobs of the kept layers have one shape (`share_mode:
/// PERMISSIVE`: one number of elements).
void check_sharing(const Net::Impl& net);

/// Takes the weights that the prototxt itself has, then those of the file, if any, matched by layer
/// name as Caffe does (docs/LAYERS.md point 9): by the names of the whole net. Shared blobs take
/// those of any layer of the group. Throws InputError naming layer, blob, expected and found, and
/// for layers without weights unless they may be missing.
void load_weights(Net::Impl& net, std::unique_ptr<proto::WeightsFile> weights,
                  const LoadOptions& options);

/// Uniform with the variance of He et al. 2015, so that activations keep their scale over depth.
void fill_randomly(Net::Impl& net, uint64_t seed);

}  // namespace revisit::engine
