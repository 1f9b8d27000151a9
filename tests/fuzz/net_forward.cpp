// A small prototxt run with random weights. A comment in its last line can give the shape of the
// inputs and letters: `# 1x3x8x8 kr` (k: keep all layers, r: reference kernels, n: inputs with NaN
// and infinities, l: the shape is known when the net is loaded, not only when it is planned).
// Results may have any value, but must be equal in a second run and with 3 threads, and near the
// reference kernels' if all layers keep rounding errors small.
#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "fuzz.h"
#include "revisit/engine/net.h"

namespace revisit::fuzz {
namespace {

constexpr int64_t kMaxWork = 3'000'000;          // multiply-accumulates, so that a case is fast
constexpr int64_t kMaxBytes = int64_t{4} << 20;  // of weights, and of an arena

struct Tensor {
  engine::Shape shape;
  std::vector<float> values;
};

struct Request {
  std::optional<engine::Shape> shape;
  engine::PlanOptions options{.max_run_bytes = kMaxBytes};
  bool special_values = false, shape_at_load = false;
};

Request parse_request(const std::string& text) {
  Request request;
  const size_t hash = text.rfind('#');
  if (hash == std::string::npos) return request;
  const size_t begin = std::min(text.find_first_not_of("# ", hash), text.size());
  const size_t end = std::min(text.find_first_of(" \n", begin), text.size());
  const std::string letters = text.substr(end);
  request.options.keep_all = letters.find('k') != std::string::npos;
  request.options.reference_kernels = letters.find('r') != std::string::npos;
  request.special_values = letters.find('n') != std::string::npos;
  request.shape_at_load = letters.find('l') != std::string::npos;
  works_or_refuses([&] { request.shape = engine::Shape::parse(text.substr(begin, end - begin)); });
  return request;
}

/// Upper bound for the work of one forward pass, in floating point to avoid overflow.
double work_of(const engine::Plan& plan) {
  double work = 0;
  for (const engine::LayerCost& layer : plan.layers()) {
    double window = 1;  // inputs that one output can depend on
    if (layer.macs == 0 && !layer.inputs.empty() && layer.type != "ReLU")
      for (const int64_t size : layer.inputs[0].axes()) window *= static_cast<double>(size);
    for (const engine::Shape& output : layer.outputs)
      work += static_cast<double>(output.elements()) * std::min(window, 4096.0);
    work += static_cast<double>(layer.macs);
  }
  return work;
}

std::vector<Tensor> forward(engine::Run& run, bool special_values) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  constexpr float kSpecial[] = {std::numeric_limits<float>::quiet_NaN(),
                                kInfinity,
                                -kInfinity,
                                -0.0F,
                                std::numeric_limits<float>::max(),
                                std::numeric_limits<float>::denorm_min()};
  for (const engine::Port& port : run.plan().inputs()) {
    const auto values = run.input(port.name).values();
    for (size_t i = 0; i < values.size(); ++i) {
      values[i] = static_cast<float>((i * 2654435761U) % 2001) / 1000.0F - 1;
      if (special_values && i % 7 == 3) values[i] = kSpecial[i / 7 % std::size(kSpecial)];
    }
  }
  run.forward();
  std::vector<Tensor> outputs;
  for (const engine::Port& port : run.plan().outputs()) {
    const auto view = run.output(port.name);
    outputs.push_back({view.shape, {view.values().begin(), view.values().end()}});
  }
  return outputs;
}

bool same(float a, float b) {
  return a == b ? std::signbit(a) == std::signbit(b) : std::isnan(a) && std::isnan(b);
}

bool same(const std::vector<Tensor>& a, const std::vector<Tensor>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const auto& x, const auto& y) {
    return std::equal(x.values.begin(), x.values.end(), y.values.begin(), y.values.end(),
                      [](float p, float q) { return same(p, q); });
  });
}

/// Returns whether no layer amplifies rounding errors, so that fast kernels can be compared with
/// the reference. `text` is needed because parameters can make an LRN or a ReLU amplify.
bool keeps_rounding_small(const engine::Plan& plan, const std::string& text) {
  static const std::set<std::string> kTypes = {"Input",  "Convolution", "Pooling", "ReLU", "LRN",
                                               "Concat", "Dropout",     "Split",   "Slice"};
  return text.find("lrn_param") == std::string::npos &&
         text.find("relu_param") == std::string::npos &&
         std::ranges::all_of(plan.layers(), [](const engine::LayerCost& layer) {
           return kTypes.contains(layer.type);
         });
}

/// Assumes inputs and weights of about 1.
bool near(const std::vector<Tensor>& found, const std::vector<Tensor>& wanted) {
  constexpr float kTolerance = 1e-3F;
  for (size_t i = 0; i < wanted.size(); ++i) {
    float largest = 1;
    for (const float value : wanted[i].values) largest = std::max(largest, std::abs(value));
    if (!std::isfinite(largest * largest)) continue;  // an LRN squares
    for (size_t j = 0; j < wanted[i].values.size(); ++j)
      if (!(std::abs(found[i].values[j] - wanted[i].values[j]) <= kTolerance * largest))
        return false;
  }
  return true;
}

void load_and_run(const std::string& text) {
  Request request = parse_request(text);
  const InputFile file(text);
  std::map<std::string, engine::Shape> shapes;
  if (request.shape)
    for (const std::string& blob : engine::input_blobs(file.path(), {.allow_unknown = true}))
      shapes.insert_or_assign(blob, *request.shape);
  engine::LoadOptions load{.allow_unknown = true, .limits = {.weight_bytes = kMaxBytes}};
  if (request.shape_at_load) load.inputs = shapes;
  const engine::Net net = engine::Net::load_with_random_weights(file.path(), 1, load);

  const engine::Plan plan = net.plan(shapes, request.options);
  if (work_of(plan) > kMaxWork) return;
  engine::Run run(plan);
  const std::vector<Tensor> outputs = forward(run, request.special_values);
  const bool draws = text.find("sample_weights_test") != std::string::npos;  // passes differ
  require(draws || same(outputs, forward(run, request.special_values)),
          "a second forward pass gives the same");
  request.options.threads = 3;
  engine::Run threaded(net.plan(shapes, request.options));
  require(same(outputs, forward(threaded, request.special_values)),
          "the result does not depend on the number of threads");
  if (request.special_values || !keeps_rounding_small(plan, text)) return;
  request.options.reference_kernels = true;
  engine::Run reference(net.plan(shapes, request.options));
  require(near(outputs, forward(reference, false)), "the result is the reference's");
}

}  // namespace
}  // namespace revisit::fuzz

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace revisit;
  fuzz::works_or_refuses([&] { fuzz::load_and_run(fuzz::text(data, size)); });
  return 0;
}
