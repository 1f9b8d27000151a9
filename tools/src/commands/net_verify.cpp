#include <algorithm>
#include <cmath>
#include <iostream>
#include <set>

#include "cli/interrupt.h"
#include "cli/progress.h"
#include "cli/table.h"
#include "net_commands.h"
#include "revisit/proto/npy.h"
#include "verify/golden_case.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// How far apart two arrays are: max|a - b| / max|b|, or max|a - b| alone for probabilities. Where
/// one is NaN or infinite the other must be the same: else infinity.
double error_of(std::span<const float> found, std::span<const float> wanted, bool absolute) {
  if (found.size() != wanted.size()) return INFINITY;
  double worst = 0, largest = 0;
  for (size_t i = 0; i < found.size(); ++i) {
    if (std::isfinite(found[i]) && std::isfinite(wanted[i])) {
      worst = std::max(worst, std::abs(static_cast<double>(found[i]) - wanted[i]));
      largest = std::max(largest, std::abs(static_cast<double>(wanted[i])));
    } else if (!(std::isnan(found[i]) && std::isnan(wanted[i])) && found[i] != wanted[i]) {
      return INFINITY;
    }
  }
  return largest > 0 && !absolute ? worst / largest : worst;
}

/// The worst of a case, and the first layer that is off.
struct Verdict {
  int compared = 0;
  double worst = 0;
  std::string worst_at, diverges_at, failure;
  double tolerance = 0;

  void add(const std::string& what, double error, bool is_probability = false) {
    constexpr double kProbability = 1e-6;  // absolute: small probabilities have few exact digits
    ++compared;
    if (!(error <= worst)) worst = error, worst_at = what;
    if (!(error <= (is_probability ? kProbability : tolerance)) && diverges_at.empty())
      diverges_at = what;
  }
  bool passed() const { return failure.empty() && diverges_at.empty() && compared > 0; }
};

/// Compares one layer with the array or the statistics of the original.
void compare_layer(const engine::Run& run, const GoldenLayer& golden, Verdict* verdict) {
  const engine::View<const float> output = run.output(engine::port_name(golden.layer, golden.port));
  const auto values = output.values();
  if (!golden.file.empty()) {
    const proto::NpyArray wanted = proto::read_npy(golden.file);
    const bool is_probability = golden.type == "Softmax";
    verdict->add(golden.layer,
                 output.shape.axes() == wanted.shape ? error_of(values, wanted.data, is_probability)
                                                     : INFINITY,
                 is_probability);
    return;
  }
  double squares = 0, largest = 0;
  for (const float value : values) {
    squares += static_cast<double>(value) * value;
    largest = std::max(largest, std::abs(static_cast<double>(value)));
  }
  const double scale = golden.absmax > 0 ? golden.absmax : 1;
  const double rms = std::sqrt(squares / static_cast<double>(values.size()));
  double error = std::max(std::abs(largest - golden.absmax), std::abs(rms - golden.rms)) / scale;
  const size_t n = std::min(golden.first.size(), values.size());
  for (size_t i = 0; i < n; ++i) {
    error = std::max(error, std::abs(static_cast<double>(values[i]) - golden.first[i]) / scale);
    error = std::max(error, std::abs(static_cast<double>(values[values.size() - n + i]) -
                                     golden.last[golden.last.size() - n + i]) /
                                scale);
  }
  verdict->add(golden.layer, error);
}

/// Layer types that only choose or move values: their nets must agree to the last bit.
bool only_moves_values(const engine::Plan& plan) {
  static const std::set<std::string> kMoving = {"Input",   "ReLU",    "Concat", "Slice",
                                                "Crop",    "Flatten", "Split",  "Reshape",
                                                "Dropout", "Permute", "Silence"};
  return std::all_of(plan.layers().begin(), plan.layers().end(),
                     [](const engine::LayerCost& layer) {
                       return kMoving.count(layer.type) || layer.kernel == "max-pool";
                     });
}

/// The kept value that `name` (with '/' written as '_') means: an output of the net, or a blob as
/// it is after the whole run, which is what the last layer that writes it made of it.
std::string find_output(const engine::Plan& plan, const std::string& name) {
  const auto means = [&](std::string candidate) {
    std::replace(candidate.begin(), candidate.end(), '/', '_');
    return candidate == name;
  };
  if (name.empty() && plan.outputs().size() == 1) return plan.outputs()[0].name;
  for (const engine::Port& port : plan.outputs())
    if (means(port.name)) return port.name;
  for (size_t i = plan.layers().size(); i-- > 0;) {
    const engine::LayerCost& layer = plan.layers()[i];
    for (size_t port = 0; port < layer.blobs.size(); ++port)
      if (means(layer.blobs[port])) return engine::port_name(layer.name, port);
  }
  throw InputError(str("the net has no blob '", name, "'"));
}

/// The type of the layer whose output `name` is.
std::string writer_type(const engine::Plan& plan, const std::string& name) {
  for (size_t i = plan.layers().size(); i-- > 0;) {
    const engine::LayerCost& layer = plan.layers()[i];
    if (layer.name == name ||
        std::find(layer.blobs.begin(), layer.blobs.end(), name) != layer.blobs.end())
      return layer.type;
  }
  return "";
}

Verdict verify(const GoldenCase& golden, double tolerance, int threads, bool reference) {
  Verdict verdict;
  verdict.tolerance = tolerance;
  try {
    std::map<std::string, proto::NpyArray> arrays;
    engine::LoadOptions load;
    for (const auto& [blob, file] : golden.inputs) {
      const std::string name = blob.empty() ? engine::input_blobs(golden.prototxt).at(0) : blob;
      arrays[name] = proto::read_npy(file);
      load.inputs.insert_or_assign(name, engine::Shape(arrays[name].shape));
    }
    const engine::Net net = golden.weights
                                ? engine::Net::load(golden.prototxt, *golden.weights, load)
                                : engine::Net::load_without_weights(golden.prototxt, load);
    engine::Run run(net.plan({}, {threads, true, reference}));
    if (only_moves_values(run.plan())) verdict.tolerance = 0;
    for (const auto& [name, array] : arrays)
      std::copy(array.data.begin(), array.data.end(), run.input(name).data);
    run.forward();
    for (const GoldenLayer& layer : golden.layers)
      if (layer.type != "Split") compare_layer(run, layer, &verdict);  // Caffe inserts them itself
    for (const auto& [name, file] : golden.outputs) {
      const proto::NpyArray wanted = proto::read_npy(file);
      const std::string output = find_output(run.plan(), name);
      const engine::View<const float> found = run.output(output);
      const bool is_probability = writer_type(run.plan(), output) == "Softmax";
      verdict.add(output,
                  found.shape.axes() == wanted.shape
                      ? error_of(found.values(), wanted.data, is_probability)
                      : INFINITY,
                  is_probability);
    }
    if (verdict.compared == 0) verdict.failure = "nothing to compare with";
  } catch (const std::exception& error) {
    verdict.failure = error.what();
  }
  return verdict;
}

}  // namespace

int net_verify_command(const Arguments& arguments) {
  std::vector<fs::path> folders;
  double tolerance = 1e-5;
  int threads = 1;
  bool reference = false;
  Parser parser("revisit net verify", "DIR...",
                "Run networks and compare with outputs of the original, layer by layer where those "
                "are there: the "
                "largest error (max|a-b| / max|b|) of each case, and the first layer that "
                "diverges. Nets that only move "
                "values must agree exactly. Folders are searched for cases.",
                "  revisit net verify golden/zoo golden/slim\n  revisit net verify --tolerance "
                "1e-4 my_model/\n");
  parser.positional("DIR", &folders);
  parser.option("tolerance", "E", "largest relative error of a layer (default 1e-5)", &tolerance);
  parser.option("threads", "N", "threads of one forward pass (default 1)", &threads);
  parser.flag("reference", "use the slow reference kernels", &reference);
  parser.parse(arguments);

  std::vector<GoldenCase> cases;
  for (const fs::path& folder : folders)
    for (GoldenCase& golden : find_golden_cases(folder)) cases.push_back(std::move(golden));

  Progress progress("verifying", "cases");
  Table table({"case", "verdict", "compared", "worst error", "at", "first that diverges"});
  int failed = 0;
  for (size_t i = 0; i < cases.size(); ++i) {
    progress.update(static_cast<int64_t>(i), static_cast<int64_t>(cases.size()));
    if (interrupted()) throw Interrupted(str("stopped after ", i, " of ", cases.size(), " cases"));
    const Verdict verdict = verify(cases[i], tolerance, threads, reference);
    failed += !verdict.passed();
    table.row({cases[i].name, verdict.passed() ? "ok" : "FAILED", str(verdict.compared),
               str(verdict.worst), verdict.worst_at,
               verdict.failure.empty() ? verdict.diverges_at : verdict.failure});
  }
  table.print(std::cout);
  std::cout << "\n"
            << cases.size() - static_cast<size_t>(failed) << " of " << cases.size()
            << " cases agree\n";
  return failed ? kCheckFailed : kOk;
}

}  // namespace revisit::cli
