#include "compare_case.h"

#include <algorithm>
#include <cmath>

#include "revisit/engine/net.h"
#include "revisit/proto/npy.h"

namespace revisit::cli {
namespace {

constexpr double kProbability = 1e-6;  // absolute: small probabilities have few exact digits
constexpr double kMaxRounding = 1e-4;

struct LayerError {
  std::string layer;
  double error;
  bool is_probability;
};

/// max|a - b| / max|b|, or max|a - b| if `absolute`; infinity if NaNs or infinities differ.
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

LayerError compare_array(const std::string& layer, const engine::View<const float>& found,
                         const std::filesystem::path& file, bool is_probability) {
  const proto::NpyArray wanted = proto::read_npy(file);
  return {layer,
          found.shape.axes() == wanted.shape ? error_of(found.values(), wanted.data, is_probability)
                                             : INFINITY,
          is_probability};
}

LayerError compare_statistics(const GoldenLayer& golden, std::span<const float> values) {
  double squares = 0, largest = 0;
  for (const float value : values) {
    squares += static_cast<double>(value) * value;
    largest = std::max(largest, std::abs(static_cast<double>(value)));
  }
  const double scale = golden.absmax > 0 ? golden.absmax : 1;
  const double rms = std::sqrt(squares / static_cast<double>(values.size()));
  double error = std::max(std::abs(largest - golden.absmax), std::abs(rms - golden.rms)) / scale;
  const size_t n = std::min({golden.first.size(), golden.last.size(), values.size()});
  for (size_t i = 0; i < n; ++i) {
    error = std::max(error, std::abs(static_cast<double>(values[i]) - golden.first[i]) / scale);
    error = std::max(error, std::abs(static_cast<double>(values[values.size() - n + i]) -
                                     golden.last[golden.last.size() - n + i]) /
                                scale);
  }
  return {golden.layer, std::isfinite(error) ? error : INFINITY, false};
}

LayerError compare_layer(const engine::Run& run, const GoldenLayer& golden) {
  const engine::View<const float> found =
      run.layer_output(engine::port_name(golden.layer, golden.port));
  return golden.file.empty()
             ? compare_statistics(golden, found.values())
             : compare_array(golden.layer, found, golden.file, golden.type == "Softmax");
}

double default_tolerance(const engine::Plan& plan, engine::Precision precision) {
  if (precision == engine::Precision::kBf16) return 5e-2;
  const bool winograd = std::ranges::any_of(plan.layers(), &engine::LayerCost::winograd);
  return winograd ? 1e-4 : 1e-5;
}

struct Found {
  std::string name;
  engine::View<const float> value;
};

/// Value of `name` ('/' written as '_'): an output, or a blob after its last layer.
Found find_output(const engine::Run& run, const std::string& name) {
  const engine::Plan& plan = run.plan();
  const auto means = [&](std::string candidate) {
    std::replace(candidate.begin(), candidate.end(), '/', '_');
    return candidate == name;
  };
  for (const engine::Port& port : plan.outputs())
    if (means(port.name) || (name.empty() && plan.outputs().size() == 1))
      return {port.name, run.output(port.name)};
  for (size_t i = plan.layers().size(); i-- > 0;) {
    const engine::LayerCost& layer = plan.layers()[i];
    for (size_t port = 0; port < layer.blobs.size(); ++port)
      if (means(layer.blobs[port])) {
        const std::string place = engine::port_name(layer.name, port);
        return {place, run.layer_output(place)};
      }
  }
  throw InputError("the net has no blob '", name, "'");
}

std::string writer_type(const engine::Plan& plan, const std::string& name) {
  for (size_t i = plan.layers().size(); i-- > 0;) {
    const engine::LayerCost& layer = plan.layers()[i];
    if (layer.name == name || std::ranges::count(layer.blobs, name)) return layer.type;
  }
  return "";
}

double largest_error(const engine::Run& a, const engine::Run& b) {
  double worst = 0;
  for (const engine::LayerCost& layer : a.plan().layers())
    for (size_t port = 0; port < layer.outputs.size(); ++port) {
      const std::string name = engine::port_name(layer.name, port);
      worst = std::max(worst, error_of(a.layer_output(name).values(), b.layer_output(name).values(),
                                       layer.type == "Softmax"));
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
                                   .accuracy = options_.accuracy,
                                   .precision = options_.precision}));
    for (const auto& [name, array] : arrays_)
      std::copy(array.data.begin(), array.data.end(), run.input(name).data);
    run.forward();
    return run;
  }

  /// Layers in the order of execution, then outputs.
  std::vector<LayerError> errors(const engine::Run& run) const {
    std::vector<LayerError> errors;
    for (const GoldenLayer& layer : golden_.layers)
      if (layer.type != "Split") errors.push_back(compare_layer(run, layer));  // Caffe inserts them
    for (const auto& [name, file] : golden_.outputs) {
      const Found output = find_output(run, name);
      errors.push_back(compare_array(output.name, output.value, file,
                                     writer_type(run.plan(), output.name) == "Softmax"));
    }
    return errors;
  }

 private:
  engine::Net load() {
    engine::LoadOptions options;
    for (const auto& [blob, file] : golden_.inputs) {
      const std::string name = blob.empty() ? engine::input_blobs(golden_.prototxt).at(0) : blob;
      arrays_[name] = proto::read_npy(file);
      options.inputs.insert_or_assign(name, engine::Shape(arrays_[name].shape));
    }
    return golden_.weights ? engine::Net::load(golden_.prototxt, *golden_.weights, options)
                           : engine::Net::load_without_weights(golden_.prototxt, options);
  }

  const GoldenCase& golden_;
  const CompareOptions& options_;
  std::map<std::string, proto::NpyArray> arrays_;
  engine::Net net_;
};

}  // namespace

CaseVerdict compare_case(const GoldenCase& golden, const CompareOptions& options) {
  CaseVerdict verdict;
  try {
    const Comparison comparison(golden, options);
    const engine::Run run = comparison.run(options.threads, options.reference_kernels);
    const bool moves_values = std::ranges::all_of(run.plan().layers(), &engine::LayerCost::exact);
    const double tolerance =
        moves_values ? 0
                     : options.tolerance.value_or(default_tolerance(run.plan(), options.precision));
    const auto limit = [&](const LayerError& e) {
      const bool strict = e.is_probability && options.precision == engine::Precision::kFloat32;
      return strict ? std::min(kProbability, tolerance) : tolerance;
    };
    std::optional<double> rounding;
    for (const LayerError& e : comparison.errors(run)) {
      ++verdict.compared;
      verdict.errors.emplace_back(e.layer, e.error);
      if (!(e.error <= verdict.worst)) verdict.worst = e.error, verdict.worst_at = e.layer;
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
      if (verdict.diverges_at.empty()) verdict.diverges_at = e.layer;
    }
    if (verdict.compared == 0) verdict.failure = "nothing to compare with";
  } catch (const std::exception& error) {
    verdict.failure = error.what();
  }
  return verdict;
}

}  // namespace revisit::cli
