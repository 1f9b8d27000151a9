#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "options.h"
#include "revisit/engine/net.h"

namespace revisit::caffe {
class NetParameter;
}

namespace revisit::cli {

/// Limits for untrusted files, and of the memory of a run.
struct LimitOptions {
  std::map<std::string, double> given;  // by key, see declare()
  std::vector<std::string> allowed;     // "missing", "unknown"

  void declare(Options& options);
  proto::Limits limits() const;
  int64_t run_bytes() const;
  bool allows(const std::string& word) const;
};

/// "conv3", or "conv3+pool5" with the layer to graft. "" for all of the net.
std::pair<std::string, std::string> parse_cut(const std::string& text);

struct NetOptions {
  std::filesystem::path prototxt;
  std::optional<std::filesystem::path> weights;
  std::string end;                        // parse_cut()
  std::vector<std::string> input_shapes;  // "1x3x107x4000" or "data=1x3x107x4000"
  uint64_t seed = 1;                      // for random weights
  int threads = 1;
  bool strict_accuracy = false;
  engine::Precision precision = engine::Precision::kFloat32;
  LimitOptions limits;

  /// `needs_net`: PROTOTXT is required.
  void declare(Options& options, bool needs_net = true);
  engine::LoadOptions load_options() const;
  engine::PlanOptions plan_options() const;
  std::vector<std::string> input_blobs() const;
};

void declare_input_shape(Options& options, std::vector<std::string>* shapes);

/// Sets the shapes of Input layers. Throws UsageError naming `prototxt` for an unknown input.
void set_input_shapes(const std::filesystem::path& prototxt, const std::vector<std::string>& shapes,
                      caffe::NetParameter* net);

void declare_precision(Options& options, engine::Precision* precision);

void declare_accuracy(Options& options, bool* strict);

/// Warnings of variables of the environment that slow OpenBLAS down.
std::vector<std::string> slow_settings();

enum class NoWeights { kRandom, kNone };

/// Prints warnings of the net to standard error.
engine::Net load_net(const NetOptions& options, NoWeights otherwise);

/// Path of the weights, "random" or "none".
std::string weights_source(const NetOptions& options, NoWeights otherwise);

}  // namespace revisit::cli
