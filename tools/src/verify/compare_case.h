#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "revisit/engine/net.h"

namespace revisit::cli {

/// Outputs of the original: a folder with `net.prototxt`, `weights.caffemodel` (or
/// `.caffemodel.h5`, if it has weights), `in_BLOB.npy` for each input and `out_NAME.npy` for any
/// blobs, as after a forward pass, or layers. '/' in names is written as '_'.
struct GoldenCase {
  std::string name;  // of the folder
  std::filesystem::path prototxt;
  std::optional<std::filesystem::path> weights;
  std::map<std::string, std::filesystem::path> inputs, outputs;  // by the names in file names
};

/// Finds the cases in and below `folder`. Throws InputError if there is none.
std::vector<GoldenCase> find_golden_cases(const std::filesystem::path& folder);

struct CaseVerdict {
  int compared = 0;  // outputs
  int rounding = 0;  // outputs that passed only as amplified rounding, see below
  double worst = 0;  // error of `worst_at`
  std::string worst_at, diverges_at, failure;
  std::vector<std::pair<std::string, double>> errors;  // in the order of execution
  bool passed() const { return failure.empty() && diverges_at.empty() && compared > 0; }
};

struct CompareOptions {
  /// Default: 1e-5; 1e-4 with Winograd kernels (tests/golden/README.md); 5e-2 in bf16.
  std::optional<double> tolerance;
  int threads = 1;
  bool reference_kernels = false;
  bool strict_accuracy = false;
  engine::Precision precision = engine::Precision::kFloat32;
};

/// Error of an output: max|a - b| / max|b|; of a Softmax: max|a - b| with tolerance 1e-6 (not in
/// bf16). Nets that only move values must agree exactly. Exceptions go to the verdict's `failure`.
///
/// Some nets amplify rounding: batch normalization of channels with little variance, or a softmax
/// of large scores that nearly cancel. An output beyond the tolerance then passes below 2d, at most
/// 1e-4. d: largest difference between our fast and reference kernels in any layer; 2d, because we
/// and the original may deviate in opposite directions.
CaseVerdict compare_case(const GoldenCase& golden, const CompareOptions& options);

}  // namespace revisit::cli
