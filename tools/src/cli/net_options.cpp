#include "net_options.h"

#include <algorithm>
#include <cstdlib>
#include <functional>
#include <map>

#include "caffe_schema.pb.h"
#include "cli/terminal.h"
#include "revisit/engine/machine.h"

namespace revisit::cli {
namespace {

constexpr double kMaxMb = int64_t{1} << 40;  // so that bytes do not overflow

int64_t megabytes(double n) {
  return static_cast<int64_t>(n) << 20;
}

/// A shape without a blob name belongs to the net's only input. Throws UsageError.
std::map<std::string, engine::Shape> named_shapes(
    const std::vector<std::string>& texts, const std::filesystem::path& prototxt,
    const std::function<std::vector<std::string>()>& inputs_of_net) {
  std::map<std::string, engine::Shape> shapes;
  for (const std::string& text : texts) {
    const size_t equals = text.rfind('=');
    std::string blob = equals == std::string::npos ? "" : text.substr(0, equals);
    if (blob.empty()) {
      const std::vector<std::string> inputs = inputs_of_net();
      if (inputs.size() != 1)
        throw UsageError("--input-shape: ", prototxt.string(), " has ", inputs.size(),
                         " inputs; say which one: BLOB=", text);
      blob = inputs[0];
    }
    shapes.insert_or_assign(
        blob, engine::Shape::parse(text.substr(equals == std::string::npos ? 0 : equals + 1)));
  }
  return shapes;
}

}  // namespace

void set_input_shapes(const std::filesystem::path& path, const std::vector<std::string>& texts,
                      caffe::NetParameter* net) {
  std::vector<std::string> inputs;
  for (const caffe::LayerParameter& layer : net->layer())
    if (layer.type() == "Input")
      inputs.insert(inputs.end(), layer.top().begin(), layer.top().end());
  auto shapes = named_shapes(texts, path, [&inputs] { return inputs; });
  for (const auto& [blob, shape] : shapes)
    if (std::ranges::find(inputs, blob) == inputs.end())
      throw UsageError("--input-shape: ", path.string(), " has no input '", blob, "'",
                       nearest_name_hint(blob, inputs));
  for (caffe::LayerParameter& layer : *net->mutable_layer()) {
    if (layer.type() != "Input") continue;
    const auto& tops = layer.top();
    if (std::ranges::none_of(tops, [&](const auto& top) { return shapes.contains(top); })) continue;
    caffe::InputParameter& param = *layer.mutable_input_param();
    if (param.shape_size() == 1)  // one shape for all tops
      while (param.shape_size() < tops.size()) *param.add_shape() = param.shape(0);
    const bool complete = param.shape_size() == tops.size();
    while (param.shape_size() < tops.size()) param.add_shape();
    for (int i = 0; i < tops.size(); ++i) {
      const auto given = shapes.find(tops[i]);
      if (given != shapes.end()) {
        auto& axes = *param.mutable_shape(i)->mutable_dim();
        axes.Clear();
        axes.Add(given->second.axes().begin(), given->second.axes().end());
      } else if (!complete) {
        throw UsageError("--input-shape: the input '", tops[i],
                         "' has no shape either: give it, too: ", tops[i], "=NxCxHxW");
      }
    }
  }
}

void declare_input_shape(Options& options, std::vector<std::string>* shapes) {
  options.option("input-shape", "[BLOB=]NxCxHxW",
                 "shape of an input, as 1x3x107x4000 or 1,3,107,4000 (default: the file's)",
                 shapes);
}

void LimitOptions::declare(Options& options) {
  const proto::Limits standard;
  options.group("Limits for untrusted files:")
      .option("limit",
              str("text=", standard.text_bytes >> 20, ", weights=", standard.weight_bytes >> 20,
                  " [MB] of files, layers=", standard.layers,
                  " of a net, run=", engine::PlanOptions{}.max_run_bytes >> 20,
                  " [MB] of values and packed weights of a run"),
              {"text", "weights", "layers", "run"}, &given)
      .option("allow", "missing|unknown",
              "missing: initial values of fillers for layers without weights; unknown: warnings "
              "for unknown fields "
              "outside of layer parameters; repeatable (default: errors)",
              &allowed)
      .check([this] {
        for (const std::string& word : allowed)
          if (word != "missing" && word != "unknown")
            throw UsageError("--allow: expected missing or unknown, found '", word, "'",
                             nearest_name_hint(word, {"missing", "unknown"}));
        for (const auto& [key, value] : given)
          if (const double most = key == "layers" ? INT32_MAX : kMaxMb;
              !(value >= 1 && value <= most))
            throw UsageError("--limit ", key, ": expected 1 to ", exact(most), ", found ",
                             exact(value));
      });
}

proto::Limits LimitOptions::limits() const {
  proto::Limits limits;
  if (given.contains("text")) limits.text_bytes = megabytes(given.at("text"));
  if (given.contains("weights")) limits.weight_bytes = megabytes(given.at("weights"));
  if (given.contains("layers")) limits.layers = static_cast<int64_t>(given.at("layers"));
  return limits;
}

bool LimitOptions::allows(const std::string& word) const {
  return std::ranges::count(allowed, word) > 0;
}

int64_t LimitOptions::run_bytes() const {
  return given.contains("run") ? megabytes(given.at("run")) : engine::PlanOptions{}.max_run_bytes;
}

std::pair<std::string, std::string> parse_cut(const std::string& text) {
  const size_t plus = text.find('+');
  if (plus == std::string::npos) return {text, ""};
  return {text.substr(0, plus), text.substr(plus + 1)};
}

void NetOptions::declare(Options& options, bool needs_net) {
  options.argument("PROTOTXT", &prototxt).required(needs_net);
  options.argument("WEIGHTS", &weights).optional();
  options.group("Network:");
  options.option(
      "end", "LAYER[+LAYER]",
      "last layer, without in-place layers after it, e.g. conv3, or a blob (default: the net's "
      "last); "
      "conv3+pool5 appends a copy of pool5, which has no weights, with its normalization and ReLU",
      &end);
  declare_input_shape(options, &input_shapes);
  options.option("threads", "N", "threads of one forward pass (default 1)", &threads).at_least(1);
  declare_accuracy(options, &strict_accuracy);
  declare_precision(options, &precision);
  limits.declare(options);
}

std::vector<std::string> NetOptions::input_blobs() const {
  return engine::input_blobs(
      prototxt, {.allow_unknown = limits.allows("unknown"), .limits = limits.limits()});
}

engine::LoadOptions NetOptions::load_options() const {
  auto [last, graft] = parse_cut(end);
  return {.end = std::move(last),
          .graft = std::move(graft),
          .inputs = named_shapes(input_shapes, prototxt, [this] { return input_blobs(); }),
          .allow_missing = limits.allows("missing"),
          .allow_unknown = limits.allows("unknown"),
          .limits = limits.limits()};
}

engine::PlanOptions NetOptions::plan_options() const {
  return {.threads = threads,
          .max_run_bytes = limits.run_bytes(),
          .flush_denormals = !strict_accuracy,
          .strict_accuracy = strict_accuracy,
          .precision = precision};
}

void declare_precision(Options& options, engine::Precision* precision) {
  options.choice<engine::Precision>(
      "precision", {{"float32", engine::Precision::kFloat32}, {"bf16", engine::Precision::kBf16}},
      "data type of weights and of values between layers; bf16 is faster on CPUs with AVX512-BF16 "
      "(default float32)",
      precision);
}

void declare_accuracy(Options& options, bool* strict) {
  options.choice<bool>("accuracy", {{"default", false}, {"strict", true}},
                       "rounding of convolutions: default, or strict (no more than Caffe's, and "
                       "exact denormals, below 1.2e-38; slower) (default default)",
                       strict);
}

std::vector<std::string> slow_settings() {
  std::vector<std::string> warnings;
  if (const std::string faster = engine::faster_blas_core(); !faster.empty())
    warnings.push_back(str("OpenBLAS uses its ", engine::blas_core(), " kernels, this CPU can run ",
                           faster, ", which are several times faster; unset OPENBLAS_CORETYPE or ",
                           "set it to ", faster));
  if (std::getenv("OPENBLAS_L2_SIZE"))
    warnings.emplace_back(
        "OPENBLAS_L2_SIZE is set, so OpenBLAS may block for another cache size; unset it");
  return warnings;
}

engine::Net load_net(const NetOptions& options, NoWeights otherwise) {
  const engine::LoadOptions load = options.load_options();
  engine::Net net =
      options.weights ? engine::Net::load(options.prototxt, *options.weights, load)
      : otherwise == NoWeights::kRandom
          ? engine::Net::load_with_random_weights(options.prototxt, options.seed, load)
          : engine::Net::load_without_weights(options.prototxt, load);
  for (const std::string& warning : net.warnings()) warn(warning);
  return net;
}

std::string weights_source(const NetOptions& options, NoWeights otherwise) {
  if (options.weights) return options.weights->string();
  return otherwise == NoWeights::kRandom ? "random" : "none";
}

}  // namespace revisit::cli
