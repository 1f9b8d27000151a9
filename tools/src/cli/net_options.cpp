#include "net_options.h"

#include "cli/messages.h"

namespace revisit::cli {
namespace {

constexpr uint64_t kRandomSeed = 1;
constexpr int64_t kMostMb = int64_t{1} << 40;  // so that bytes do not overflow

void check_limit(const char* option, int64_t value, int64_t most) {
  if (value < 1 || value > most)
    throw UsageError(option, ": expected 1 to ", most, ", found ", value);
}

/// The input shapes by blob name; a shape without a name belongs to the only input of the net.
std::map<std::string, engine::Shape> named_shapes(const NetOptions& options) {
  std::map<std::string, engine::Shape> shapes;
  for (const std::string& text : options.input_shapes) {
    const size_t equals = text.rfind('=');
    std::string blob = equals == std::string::npos ? "" : text.substr(0, equals);
    if (blob.empty()) {
      const std::vector<std::string> inputs = options.input_blobs();
      if (inputs.size() != 1)
        throw UsageError("--input-shape: ", options.prototxt.string(), " has ", inputs.size(),
                         " inputs; say which one: BLOB=", text);
      blob = inputs[0];
    }
    shapes.insert_or_assign(
        blob, engine::Shape::parse(text.substr(equals == std::string::npos ? 0 : equals + 1)));
  }
  return shapes;
}

}  // namespace

void LimitOptions::declare(Parser& parser) {
  parser.group("Limits that keep hostile files from taking the machine's memory:");
  parser.option("max-text-mb", "N", str("largest prototxt (default ", text_mb, ")"), &text_mb);
  parser.option("max-weights-mb", "N", str("largest weights file (default ", weights_mb, ")"),
                &weights_mb);
  parser.option("max-layers", "N", str("most layers in a file (default ", layers, ")"), &layers);
}

proto::Limits LimitOptions::limits() const {
  check_limit("--max-text-mb", text_mb, kMostMb);
  check_limit("--max-weights-mb", weights_mb, kMostMb);
  check_limit("--max-layers", layers, INT32_MAX);
  proto::Limits result;
  result.text_bytes = text_mb << 20;
  result.weight_bytes = weights_mb << 20;
  result.layers = layers;
  return result;
}

void NetOptions::declare(Parser& parser) {
  parser.positional("PROTOTXT", &prototxt);
  parser.optional_positional("WEIGHTS", &weights);
  parser.group("Network:");
  parser.option("end", "LAYER",
                "cut the net off after this layer (before an in-place layer that follows)",
                &truncation.end);
  parser.option(
      "graft", "LAYER",
      "append a copy of this layer, which has no weights, after --end and its ReLU: --end conv3 "
      "--graft pool5",
      &truncation.graft);
  parser.option("input-shape", "[BLOB=]NxCxHxW", "replace an input's shape, e.g. 1x3x107x4000",
                &input_shapes);
  parser.option("threads", "N", "threads of one forward pass (default 1)", &threads);
  parser.flag("allow-missing", "layers without weights become zeros instead of an error",
              &allow_missing);
  parser.flag("allow-unknown", "unknown prototxt fields become warnings instead of errors",
              &allow_unknown);
  declare_accuracy(parser, &accuracy);
  declare_precision(parser, &precision);
  parser.flag("keep-denormals", "numbers below 1.2e-38 keep their value, as in Caffe, however slow",
              &keep_denormals);
  limits.declare(parser);
  parser.option("max-run-mb", "N",
                str("most memory for the values of one run and its kernels' packed weights "
                    "together (default ",
                    run_mb, ")"),
                &run_mb);
}

std::vector<std::string> NetOptions::input_blobs() const {
  return engine::input_blobs(prototxt, {.allow_unknown = allow_unknown, .limits = limits.limits()});
}

engine::LoadOptions NetOptions::load_options() const {
  if (threads < 1) throw UsageError("--threads: expected at least 1, found ", threads);
  return {.truncation = truncation,
          .inputs = named_shapes(*this),
          .allow_missing = allow_missing,
          .allow_unknown = allow_unknown,
          .limits = limits.limits()};
}

engine::PlanOptions NetOptions::plan_options() const {
  check_limit("--max-run-mb", run_mb, kMostMb);
  return {.threads = threads,
          .max_run_bytes = run_mb << 20,
          .flush_denormals = !keep_denormals,
          .accuracy = accuracy,
          .precision = precision};
}

void declare_precision(Parser& parser, engine::Precision* precision) {
  parser.choice<engine::Precision>(
      "precision", {{"float32", engine::Precision::kFloat32}, {"bf16", engine::Precision::kBf16}},
      "float32 (default) or bf16: values between layers and weights in bfloat16, faster on CPUs "
      "with AVX512-BF16",
      precision);
}

void declare_accuracy(Parser& parser, engine::Accuracy* accuracy) {
  parser.choice<engine::Accuracy>(
      "accuracy", {{"usual", engine::Accuracy::kUsual}, {"strict", engine::Accuracy::kStrict}},
      "usual (default) or strict: convolutions that round no more than Caffe's, slower", accuracy);
}

engine::Net load_net(const NetOptions& options, NoWeights otherwise) {
  const engine::LoadOptions load = options.load_options();
  if (!options.weights && otherwise == NoWeights::kRefuse)
    throw UsageError("this needs the network's weights: give the .caffemodel after the .prototxt");
  engine::Net net = options.weights ? engine::Net::load(options.prototxt, *options.weights, load)
                    : otherwise == NoWeights::kRandom
                        ? engine::Net::load_with_random_weights(options.prototxt, kRandomSeed, load)
                        : engine::Net::load_without_weights(options.prototxt, load);
  for (const std::string& warning : net.warnings()) warn(warning);
  return net;
}

std::string weights_source(const NetOptions& options, NoWeights otherwise) {
  if (options.weights) return options.weights->string();
  return otherwise == NoWeights::kRandom ? "random" : "none";
}

}  // namespace revisit::cli
