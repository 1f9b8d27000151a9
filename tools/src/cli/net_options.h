#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "options.h"
#include "revisit/engine/net.h"

namespace revisit::caffe {
class NetParameter;
}

namespace revisit::cli {

struct LimitOptions {
  int64_t text_mb = proto::Limits{}.text_bytes >> 20;
  int64_t weights_mb = proto::Limits{}.weight_bytes >> 20;
  int64_t layers = proto::Limits{}.layers;

  void declare(Options& options);
  proto::Limits limits() const;
};

struct NetOptions {
  std::filesystem::path prototxt;
  std::optional<std::filesystem::path> weights;
  engine::Truncation truncation;
  std::vector<std::string> input_shapes;  // "1x3x107x4000" or "data=1x3x107x4000"
  uint64_t seed = 1;                      // for random weights
  int threads = 1;
  bool allow_missing = false, allow_unknown = false, keep_denormals = false;
  engine::Accuracy accuracy = engine::Accuracy::kDefault;
  engine::Precision precision = engine::Precision::kFloat32;
  LimitOptions limits;
  int64_t run_mb = engine::PlanOptions{}.max_run_bytes >> 20;

  void declare(Options& options);
  engine::LoadOptions load_options() const;
  engine::PlanOptions plan_options() const;
  std::vector<std::string> input_blobs() const;
};

void declare_input_shape(Options& options, std::vector<std::string>* shapes);

/// Sets the shapes of Input layers. Throws UsageError naming `prototxt` for an unknown input.
void set_input_shapes(const std::filesystem::path& prototxt, const std::vector<std::string>& shapes,
                      caffe::NetParameter* net);

void declare_precision(Options& options, engine::Precision* precision);

void declare_accuracy(Options& options, engine::Accuracy* accuracy);

enum class NoWeights { kRefuse, kRandom, kNone };

/// Prints warnings of the net to standard error.
engine::Net load_net(const NetOptions& options, NoWeights otherwise);

/// Path of the weights, "random" or "none".
std::string weights_source(const NetOptions& options, NoWeights otherwise);

}  // namespace revisit::cli
