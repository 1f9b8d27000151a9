#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace revisit::caffe {
class NetParameter;
}

namespace revisit::models {

/// `trunk(name)` with random weights, its name marked as untrained: gaussian with mean 0 and
/// variance 2 / (inputs per output) (He et al. 2015), biases uniform in [-0.01, 0.01). Throws
/// UsageError for unknown names.
///
/// Number i of blob b of layer l is a function of (seed, l, b, i) alone, by the finaliser of
/// SplitMix64 (Steele et al. 2014). A gaussian is the sum of 12 uniform 32-bit integers
/// (Irwin-Hall: variance exactly 1, support +-6), without libm: the bits are the same everywhere.
caffe::NetParameter random_model(const std::string& trunk_name, uint64_t seed);

/// True for a net that `random_model` made, by its name. Such a net proves nothing about accuracy.
bool is_untrained(const caffe::NetParameter& net);

struct ModelFiles {
  std::filesystem::path prototxt, weights;
};

/// Writes `folder/<trunk_name>_random.prototxt` and `.caffemodel` atomically, or throws Error.
ModelFiles write_random_model(const std::filesystem::path& folder, const std::string& trunk_name,
                              uint64_t seed);

/// The same of a net that has random weights already: `folder/<name>_random.*`, marked as
/// untrained.
ModelFiles write_untrained(const std::filesystem::path& folder, const std::string& name,
                           uint64_t seed, caffe::NetParameter net);

}  // namespace revisit::models
