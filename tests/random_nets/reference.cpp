#include "reference.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "revisit/base/error.h"
#include "revisit/proto/net_file.h"

namespace revisit::random_nets {
namespace {

using engine::Shape;
using engine::Tensor;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr int kFewRuns = 2, kManyRuns = 40, kMaxRuns = 1000;  // with noise
constexpr double kMargin = 3;

/// Layout: [outer][count][inner].
struct Channels {
  int64_t count, inner;
  explicit Channels(const Shape& shape)
      : count(shape.rank() > 1 ? shape[1] : 1),
        inner(shape.rank() > 1 ? shape.product(2, shape.rank()) : shape.elements()) {}
  size_t of(size_t i) const {
    return static_cast<size_t>(static_cast<int64_t>(i) / std::max<int64_t>(inner, 1) % count);
  }
};

/// Size of each channel's values, at least `least`. Small channels use that of all values, because
/// theirs is chance.
std::vector<double> magnitudes(std::span<const float> values, const Shape& shape,
                               double least = 0) {
  constexpr int64_t kFew = 16;
  const Channels channels(shape);
  std::vector<double> result(static_cast<size_t>(channels.count), 0);
  for (size_t i = 0; i < values.size(); ++i)
    result[channels.of(i)] =
        std::max(result[channels.of(i)], std::abs(static_cast<double>(values[i])));
  if (shape.elements() < kFew * channels.count)
    std::fill(result.begin(), result.end(), *std::ranges::max_element(result));
  for (double& size : result) size = std::max(size, least);
  return result;
}

std::vector<bool> are_equal(std::span<const float> values, const Shape& shape) {
  const Channels channels(shape);
  std::vector<bool> result(static_cast<size_t>(channels.count), true);
  for (size_t i = 0; i < values.size(); ++i) {
    const size_t first = channels.of(i) * static_cast<size_t>(channels.inner);
    if (values[i] != values[first]) result[channels.of(i)] = false;
  }
  return result;
}

/// Ignores NaN and infinity.
struct Sizes {
  double largest = 0, squares = 0;
  int64_t count = 0;

  void add(std::span<const float> values) {
    for (const float value : values)
      if (std::isfinite(value)) {
        largest = std::max(largest, std::abs(double{value}));
        squares += double{value} * value;
        ++count;
      }
  }
  double mean() const {
    return std::sqrt(squares / static_cast<double>(std::max<int64_t>(count, 1)));
  }
};

class Disturb {
 public:
  Disturb(const engine::Run& run, const Noise& noise, uint64_t seed)
      : run_(run), noise_(noise), random_(seed) {}

  void operator()(size_t layer, bool done) {
    if (!done) return;
    const engine::LayerCost& cost = run_.plan().layers()[layer];
    const auto noise = noise_.of_layers.find(cost.name);
    if (noise == noise_.of_layers.end()) return;
    // A sum of few terms, or of a constant, may be near zero by chance. Rounding of its terms is
    // proportional to the inputs.
    Sizes of_inputs;
    for (const size_t from : cost.input_layers) {
      const engine::LayerCost& source = run_.plan().layers()[from];
      for (size_t port = 0; port < source.outputs.size(); ++port)
        of_inputs.add(run_.layer_output(proto::port_name(source.name, port)).values());
    }
    const auto weights = noise_.of_weights.find(cost.name);
    const double least =
        std::max(of_inputs.largest * noise_.of_terms,
                 weights == noise_.of_weights.end() ? 0 : weights->second * of_inputs.mean());
    for (size_t port = 0; port < cost.outputs.size(); ++port) {
      const auto view = run_.layer_output(proto::port_name(cost.name, port));
      const std::vector<double> sizes = magnitudes(view.values(), view.shape, least);
      const Channels channels(view.shape);
      const auto mean = noise_.of_means.find(cost.name);
      const double left = mean == noise_.of_means.end()
                              ? 0
                              : mean->second * of_inputs.largest * random_.real(-1, 1);
      const std::vector<bool> equal = are_equal(view.values(), view.shape);
      auto* values = const_cast<float*>(view.data);  // in the arena of a run of our own
      for (size_t i = 0; i < view.values().size(); ++i)
        values[i] +=
            static_cast<float>(noise->second * sizes[channels.of(i)] * random_.real(-1, 1) +
                               (equal[channels.of(i)] ? left : 0));
    }
  }

 private:
  const engine::Run& run_;
  const Noise& noise_;
  Random random_;
};

}  // namespace

Values forward(engine::Run& run, const Values& inputs,
               const std::function<void(size_t, bool)>& observe) {
  for (const engine::Port& port : run.plan().inputs()) {
    const Tensor& input = inputs.at(port.name);
    if (input.shape != port.shape)
      throw std::logic_error(str("input ", port.name, ": ", input.shape, ", not ", port.shape));
    std::copy(input.values.begin(), input.values.end(), run.input(port.name).data);
  }
  if (observe)
    run.forward(observe);
  else
    run.forward();
  Values result;
  const auto keep = [&](const std::string& name, const engine::View<const float>& view) {
    result[name] = {view.shape, {view.values().begin(), view.values().end()}};
  };
  for (const engine::Port& port : run.plan().outputs()) keep(port.name, run.output(port.name));
  for (const engine::LayerCost& layer : run.plan().layers())
    for (size_t port = 0; port < layer.outputs.size(); ++port) {
      const std::string name = proto::port_name(layer.name, port);
      try {
        keep(kLayer + name, run.layer_output(name));
      } catch (const UsageError&) {
        continue;  // a plan that does not keep it
      }
    }
  return result;
}

std::vector<double> differences(const Tensor& a, const Tensor& b) {
  const Channels channels(a.shape);
  std::vector<double> result(static_cast<size_t>(channels.count), 0);
  if (a.shape != b.shape) {
    std::fill(result.begin(), result.end(), kInfinity);
    return result;
  }
  for (size_t i = 0; i < a.values.size(); ++i) {
    const float x = a.values[i], y = b.values[i];
    if (x == y || (std::isnan(x) && std::isnan(y))) continue;
    const double difference = std::abs(static_cast<double>(x) - y);
    double& worst = result[channels.of(i)];
    worst = std::max(worst, std::isnan(difference) ? kInfinity : difference);
  }
  return result;
}

Reference::Reference(const engine::Net& net, const Values& inputs, Noise noise)
    : run_([&] {
        std::map<std::string, Shape> shapes;
        for (const engine::Port& port : net.inputs())
          shapes[port.name] = inputs.at(port.name).shape;
        return net.plan(shapes, {.keep_all = true, .reference_kernels = true});
      }()),
      inputs_(inputs),
      noise_(std::move(noise)) {
  engine::Run run(run_.plan());
  values_ = forward(run, inputs);
  for (const auto& [name, value] : values_)
    measured_[0][name].assign(differences(value, value).size(), 0);
}

bool Reference::is_far_from_overflow() const {
  constexpr float kFar = 1e30F;  // transforms of Winograd's and long sums do not reach infinity
  return std::all_of(values_.begin(), values_.end(), [](const auto& entry) {
    return std::all_of(entry.second.values.begin(), entry.second.values.end(),
                       [](float value) { return std::abs(value) < kFar; });
  });
}

const Reference::Deviations& Reference::measured(int runs) {
  const auto fewer = std::prev(measured_.upper_bound(runs));
  if (fewer->first == runs) return fewer->second;
  Deviations deviations = fewer->second;
  for (int i = fewer->first; i < runs; ++i) {
    engine::Run run(run_.plan());  // a new one, because some layers have state
    Disturb disturb(run, noise_, static_cast<uint64_t>(i));
    for (const auto& [name, value] : forward(run, inputs_, std::ref(disturb))) {
      const std::vector<double> found = differences(values_.at(name), value);
      std::vector<double>& largest = deviations.at(name);
      for (size_t c = 0; c < largest.size(); ++c) largest[c] = std::max(largest[c], found[c]);
    }
  }
  return measured_[runs] = std::move(deviations);
}

std::vector<double> Reference::explained(const std::string& name) {
  std::vector<double> result = measured(kManyRuns).at(name);
  for (double& deviation : result) deviation *= kMargin;
  return result;
}

std::string Reference::compare(const std::string& name, const Tensor& found, int64_t& insensitive) {
  constexpr double kHundredth = 0.01;
  const auto place = values_.find(name);
  if (place == values_.end()) return str("'", name, "' is no value of the reference");
  const Tensor& wanted = place->second;
  if (found.shape != wanted.shape)
    return str("'", name, "' is ", found.shape, ", expected ", wanted.shape);
  const std::vector<double> off = differences(wanted, found);
  std::string fault;
  std::vector<double> deviation;
  // More runs are needed to show cancellation or values at the edge of a decision, and even more at
  // a pole (a power of -1).
  for (const int runs : {kFewRuns, kManyRuns, kMaxRuns}) {
    deviation = measured(runs).at(name);
    fault.clear();
    for (size_t c = 0; c < off.size() && fault.empty(); ++c)
      if (off[c] > kMargin * deviation[c])
        fault = str("'", name, "' (", wanted.shape, "), channel ", c, ": off by ", off[c],
                    ", rounding explains ", kMargin * deviation[c]);
    if (fault.empty()) break;
  }
  const std::vector<double> sizes = magnitudes(wanted.values, wanted.shape);
  for (size_t c = 0; c < sizes.size(); ++c)
    if (deviation[c] > kHundredth * sizes[c]) {
      ++insensitive;
      break;
    }
  if (fault.empty()) return "";
  const Channels channels(wanted.shape);
  for (size_t i = 0, shown = 0; i < wanted.values.size() && shown < 5; ++i)
    if (found.values[i] != wanted.values[i] &&
        std::abs(found.values[i] - wanted.values[i]) > kMargin * deviation[channels.of(i)])
      fault += str("\n  [", i, "] ", found.values[i], ", expected ", wanted.values[i]), ++shown;
  return fault;
}

}  // namespace revisit::random_nets
