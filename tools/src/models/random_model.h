#pragma once

#include <filesystem>

#include "cli/net_options.h"

namespace revisit::models {

struct ModelFiles {
  std::filesystem::path prototxt, weights;
};

/// Writes the inference layers of a prototxt with the engine's random weights to
/// `folder`/NAME_random.prototxt and .caffemodel, marked as untrained. `requested.prototxt` is a
/// file or the name of one of own_net(). Throws UsageError for an unknown name; InputError if the
/// file does not load, or if a caffemodel cannot hold or assign the weights.
ModelFiles write_random_model(const std::filesystem::path& folder,
                              const cli::NetOptions& requested);

/// Whether the name marks a net as untrained. Such a net must not be used to measure accuracy.
bool is_untrained(const std::string& net_name);

}  // namespace revisit::models
