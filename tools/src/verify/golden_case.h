#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace revisit::cli {

/// The original's output of a layer: the array, or statistics of it.
struct GoldenLayer {
  std::string layer, type;
  int index = 0;               // in the original's list of layers
  size_t port = 0;             // index of the layer's output
  std::filesystem::path file;  // empty: only statistics
  double absmax = 0, rms = 0;
  std::vector<float> first, last;  // the first and last values in C order
};

struct GoldenCase {
  std::string name;
  std::filesystem::path prototxt;
  std::optional<std::filesystem::path> weights;
  /// By blob ("": the only input of the net), and by output name with '/' written as '_'.
  std::map<std::string, std::filesystem::path> inputs = {}, outputs = {};
  std::vector<GoldenLayer> layers = {};  // in the order of execution
};

/// Finds the cases in and below `folder`. A folder is a case if it has one of:
/// - `manifest.json`: layers with files or statistics; `VARIANT.prototxt` with
///   `out_VARIANT_SIZE.npy`, or `deploy.prototxt`,
/// - `index.json` with pairs of prototxt and weights that give the same outputs,
/// - `net.prototxt` or `deploy.prototxt` with `in_BLOB.npy` (or `in.npy`) and `out_NAME.npy`;
///   sub-folders with their own `in.npy` are other sizes of the same net.
/// Searches other folders. Throws InputError if there is no case, and for malformed JSON.
std::vector<GoldenCase> find_golden_cases(const std::filesystem::path& folder);

}  // namespace revisit::cli
