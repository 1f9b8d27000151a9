#include <algorithm>
#include <cmath>
#include <iostream>
#include <map>
#include <set>

#include "cli/net_arrays.h"
#include "cli/net_options.h"
#include "cli/terminal.h"
#include "net_commands.h"
#include "revisit/engine/net.h"
#include "revisit/proto/net_file.h"
#include "revisit/proto/npy.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// Outputs of the original: a folder with `net.prototxt`, `weights.caffemodel` (or
/// `.caffemodel.h5`, if it has weights), `in_BLOB.npy` for each input and `out_NAME.npy` for any
/// blobs, as after a forward pass, or layers. '/' in names is written as '_'.
struct GoldenCase {
  std::string name;  // of the folder
  std::filesystem::path prototxt;
  std::optional<std::filesystem::path> weights;
  std::map<std::string, std::filesystem::path> inputs, outputs;  // by the names in file names
};

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

constexpr double kProbability = 1e-6;  // absolute: small probabilities have few exact digits
constexpr double kMaxRounding = 1e-4;

struct OutputError {
  size_t layer;  // that wrote it, in the order of execution
  std::string name;
  double error;
  bool is_probability;
};

double default_tolerance(const engine::Plan& plan, engine::Precision precision) {
  if (precision == engine::Precision::kBf16) return 5e-2;
  const bool winograd = std::ranges::any_of(plan.layers(), &engine::LayerCost::winograd);
  return winograd ? 1e-4 : 1e-5;
}

/// Compares the value of `name` ('/' written as '_'): a blob after a forward pass, or a layer.
OutputError compare_output(const engine::Run& run, const std::string& name, const fs::path& file) {
  const auto is_named = [&](std::string candidate) {
    std::ranges::replace(candidate, '/', '_');
    return candidate == name;
  };
  const std::vector<engine::LayerCost>& layers = run.plan().layers();
  const proto::Blob wanted = proto::read_npy(file);
  const auto compare = [&](size_t layer, const std::string& shown,
                           const engine::View<const float>& found) {
    const bool is_probability = layers[layer].type == "Softmax";
    const double error = found.shape.axes() == wanted.shape
                             ? relative_error(found.values(), wanted.data, is_probability)
                             : INFINITY;
    return OutputError{layer, shown, error, is_probability};
  };
  for (size_t i = layers.size(); i-- > 0;)
    for (size_t port = 0; port < layers[i].blobs.size(); ++port) {
      const std::string& blob = layers[i].blobs[port];
      if (!is_named(blob)) continue;
      const bool is_output =
          std::ranges::count(run.plan().outputs(), blob, &engine::Port::name) > 0;
      return compare(
          i, blob,
          is_output ? run.output(blob) : run.layer_output(proto::port_name(layers[i].name, port)));
    }
  for (size_t i = 0; i < layers.size(); ++i)
    if (is_named(layers[i].name))
      return compare(i, layers[i].name, run.layer_output(layers[i].name));
  throw InputError(file.string(), ": the net has no blob or layer '", name, "'");
}

double largest_error(const engine::Run& a, const engine::Run& b) {
  double worst = 0;
  for (const engine::LayerCost& layer : a.plan().layers())
    for (size_t port = 0; port < layer.outputs.size(); ++port) {
      const std::string name = proto::port_name(layer.name, port);
      worst =
          std::max(worst, relative_error(a.layer_output(name).values(),
                                         b.layer_output(name).values(), layer.type == "Softmax"));
    }
  return worst;
}

class Comparison {
 public:
  Comparison(const GoldenCase& golden, const CompareOptions& options)
      : golden_(golden), options_(options), net_(load()) {}

  engine::Run run(int threads, bool reference_kernels) const {
    engine::Run run(net_.plan({}, {.threads = threads,
                                   .keep_all = true,
                                   .reference_kernels = reference_kernels,
                                   .strict_accuracy = options_.strict_accuracy,
                                   .precision = options_.precision}));
    for (const auto& [name, array] : arrays_)
      std::copy(array.data.begin(), array.data.end(), run.input(name).data);
    run.forward();
    return run;
  }

  /// In the order of execution.
  std::vector<OutputError> errors(const engine::Run& run) const {
    std::vector<OutputError> errors;
    for (const auto& [name, file] : golden_.outputs)
      errors.push_back(compare_output(run, name, file));
    std::ranges::stable_sort(errors, {}, &OutputError::layer);
    return errors;
  }

 private:
  engine::Net load() {
    engine::LoadOptions options;
    for (const std::string& blob : engine::input_blobs(golden_.prototxt)) {
      std::string name = blob;
      std::ranges::replace(name, '/', '_');
      const auto file = golden_.inputs.find(name);
      if (file == golden_.inputs.end())
        throw InputError("the input '", blob, "' has no in_", name, ".npy");
      arrays_[blob] = proto::read_npy(file->second);
      options.inputs.insert_or_assign(blob, engine::Shape(arrays_[blob].shape));
    }
    return golden_.weights ? engine::Net::load(golden_.prototxt, *golden_.weights, options)
                           : engine::Net::load_without_weights(golden_.prototxt, options);
  }

  const GoldenCase& golden_;
  const CompareOptions& options_;
  std::map<std::string, proto::Blob> arrays_;
  engine::Net net_;
};

/// Files `prefix`NAME.npy of a folder, by NAME.
std::map<std::string, fs::path> arrays_in(const fs::path& folder, const std::string& prefix) {
  std::map<std::string, fs::path> arrays;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
    const fs::path& file = entry.path();
    const std::string stem = file.stem().string();
    if (stem.starts_with(prefix) && file.extension() == ".npy")
      arrays[stem.substr(prefix.size())] = file;
  }
  return arrays;
}

void search(const fs::path& folder, std::vector<GoldenCase>* cases) {
  GoldenCase golden{folder.filename().string(), folder / "net.prototxt", std::nullopt,
                    arrays_in(folder, "in_"), arrays_in(folder, "out_")};
  if (fs::exists(golden.prototxt) && !golden.outputs.empty()) {
    for (const char* name : {"weights.caffemodel", "weights.caffemodel.h5"})
      if (!golden.weights && fs::exists(folder / name)) golden.weights = folder / name;
    cases->push_back(std::move(golden));
    return;
  }
  const std::set<fs::path> entries(fs::directory_iterator(folder), fs::directory_iterator{});
  for (const fs::path& entry : entries)
    if (fs::is_directory(entry)) search(entry, cases);
}

/// Finds the cases in and below `folder`. Throws InputError if there is none.
std::vector<GoldenCase> find_golden_cases(const fs::path& folder) {
  if (!fs::is_directory(folder)) throw InputError(folder.string() + ": no such folder");
  std::vector<GoldenCase> cases;
  try {
    search(fs::canonical(folder), &cases);
  } catch (const fs::filesystem_error& error) {
    throw InputError(error.what());
  }
  if (cases.empty())
    throw InputError(folder.string() +
                     ": no case found (expected net.prototxt, in_BLOB.npy and out_NAME.npy)");
  return cases;
}

/// Error of an output: max|a - b| / max|b|; of a Softmax: max|a - b| with tolerance 1e-6 (not in
/// bf16). Nets that only move values must agree exactly. Exceptions go to the verdict's `failure`.
///
/// Some nets amplify rounding: batch normalization of channels with little variance, or a softmax
/// of large scores that nearly cancel. An output beyond the tolerance then passes below 2d, at most
/// 1e-4. d: largest difference between our fast and reference kernels in any layer; 2d, because we
/// and the original may deviate in opposite directions.
CaseVerdict compare_case(const GoldenCase& golden, const CompareOptions& options) {
  CaseVerdict verdict;
  try {
    const Comparison comparison(golden, options);
    const engine::Run run = comparison.run(options.threads, options.reference_kernels);
    const bool moves_values = std::ranges::all_of(run.plan().layers(), &engine::LayerCost::exact);
    const double tolerance =
        moves_values ? 0
                     : options.tolerance.value_or(default_tolerance(run.plan(), options.precision));
    const auto limit = [&](const OutputError& e) {
      const bool strict = e.is_probability && options.precision == engine::Precision::kFloat32;
      return strict ? std::min(kProbability, tolerance) : tolerance;
    };
    std::optional<double> rounding;
    for (const OutputError& e : comparison.errors(run)) {
      ++verdict.compared;
      verdict.errors.emplace_back(e.name, e.error);
      if (!(e.error <= verdict.worst)) verdict.worst = e.error, verdict.worst_at = e.name;
      if (e.error <= limit(e)) continue;
      if (tolerance > 0 && e.error <= kMaxRounding) {
        if (!rounding)
          rounding =
              largest_error(run, comparison.run(options.threads, !options.reference_kernels));
        if (e.error <= 2 * *rounding) {
          ++verdict.rounding;
          continue;
        }
      }
      if (verdict.diverges_at.empty()) verdict.diverges_at = e.name;
    }
  } catch (const std::exception& error) {
    verdict.failure = error.what();
  }
  return verdict;
}

struct VerifyOptions {
  std::vector<fs::path> folders;
  CompareOptions compare;
  bool layers = false;

  void declare(Options& options) {
    options.argument("DIR", &folders);
    options
        .option("tolerance", "E",
                "maximum relative error of an output (default 1e-5; 1e-4 for Winograd kernels; "
                "5e-2 for bf16)",
                &compare.tolerance)
        .positive();
    options.option("threads", "N", "threads of one forward pass (default 1)", &compare.threads);
    declare_accuracy(options, &compare.strict_accuracy);
    declare_precision(options, &compare.precision);
    options.flag("layers", "error of each output of each case", &layers);
    options.flag("reference", "slow reference kernels", &compare.reference_kernels);
  }
};

int verify(VerifyOptions& o) {
  std::vector<GoldenCase> cases;
  for (const fs::path& folder : o.folders)
    for (GoldenCase& golden : find_golden_cases(folder)) cases.push_back(std::move(golden));

  Progress progress("verifying", "cases");
  Table table(
      {"case", "verdict", "compared", "rounding", "worst error", "at", "first that diverges"});
  Table errors({"case", "output", "error"});
  int failed = 0;
  for (size_t i = 0; i < cases.size(); ++i) {
    progress.update(static_cast<int64_t>(i), static_cast<int64_t>(cases.size()));
    if (interrupted()) throw Interrupted("interrupted after ", i, " of ", cases.size(), " cases");
    const CaseVerdict verdict = compare_case(cases[i], o.compare);
    failed += !verdict.passed();
    for (const auto& [layer, error] : verdict.errors)
      errors.row({cases[i].name, layer, str(error)});
    table.row({cases[i].name, verdict.passed() ? "ok" : "FAILED", str(verdict.compared),
               verdict.rounding ? str(verdict.rounding) : "", str(verdict.worst), verdict.worst_at,
               verdict.failure.empty() ? verdict.diverges_at : verdict.failure});
  }
  table.print(std::cout);
  if (o.layers) {
    std::cout << "\n";
    errors.print(std::cout);
  }
  std::cout << "\n"
            << cases.size() - static_cast<size_t>(failed) << " of " << cases.size()
            << " cases agree\n";
  return failed ? kCheckFailed : kOk;
}

}  // namespace

Command net_verify_command() {
  return {"verify", "comparison with outputs of the original",
          "Runs networks and compares with outputs of the original: the largest error (max|a-b| / "
          "max|b|) of each case, and the first output that diverges. A case is a folder with "
          "net.prototxt, weights.caffemodel or weights.caffemodel.h5, in_BLOB.npy for each input, "
          "and out_NAME.npy for any blobs, as after a forward pass, or layers ('/' in names "
          "becomes '_'); it may be anywhere below DIR. Nets that only move values must agree "
          "exactly. If a net amplifies rounding, so that single and double precision kernels "
          "differ by d, an output passes within 2d, at most 1e-4 ('rounding' counts these "
          "outputs).",
          "  revisit net verify my_model/\n"
          "  revisit net verify --tolerance 1e-4 my_model/ other_model/\n"
          "  revisit net verify --precision bf16 --layers my_model/\n",
          with_options<VerifyOptions>(verify)};
}

}  // namespace revisit::cli
