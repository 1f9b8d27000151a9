#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace revisit::caffe {
class NetParameter;
}

namespace revisit::models {

/// Returns `trunk(name)` with random weights and a name that marks it as untrained: Gaussian with
/// mean 0 and variance 2 / (inputs per output) (He et al. 2015), biases uniform in [-0.01, 0.01).
/// Throws UsageError for unknown names.
///
/// Value i of blob b of layer l depends only on (seed, l, b, i), by the finalizer of SplitMix64
/// (Steele et al. 2014). A Gaussian is the sum of 12 uniform 32-bit integers (Irwin-Hall: variance
/// exactly 1, support +-6) without libm, so the bits are equal on all platforms.
caffe::NetParameter random_model(const std::string& trunk_name, uint64_t seed);

/// Whether the name marks a net as untrained. Such a net must not be used to measure accuracy.
bool is_untrained(const caffe::NetParameter& net);

struct ModelFiles {
  std::filesystem::path prototxt, weights;
};

/// Writes `folder/<trunk_name>_random.prototxt` and `.caffemodel` atomically. Throws Error.
ModelFiles write_random_model(const std::filesystem::path& folder, const std::string& trunk_name,
                              uint64_t seed);

/// Writes a net that already has random weights to `folder/<name>_random.*`, marked as untrained.
ModelFiles write_untrained(const std::filesystem::path& folder, const std::string& name,
                           uint64_t seed, caffe::NetParameter net);

}  // namespace revisit::models
