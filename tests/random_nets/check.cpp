#include "check.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <set>

#include "reference.h"
#include "revisit/base/error.h"
#include "revisit/engine/parallel_for.h"
#include "revisit/proto/npy.h"
#include "simd_targets.h"
#include "testing.h"

namespace revisit::random_nets {
namespace {

using engine::Net;
using engine::Plan;
using engine::PlanOptions;
using engine::Shape;
using engine::Tensor;

/// Tolerances of tests/golden/README.md: sums in any order, and Winograd kernels.
constexpr double kNoise = 1e-5, kWinogradNoise = 1e-4;
/// Sums of Caffe in other orders (tests/golden/README.md).
constexpr double kMeanNoise = 1e-6;
/// Rounding of inputs, weights and output to bfloat16, each up to 2^-9.
constexpr double kBf16Noise = 1e-2, kBf16Terms = 0.5;
constexpr std::array kThreads{1, 2, 3, 7, 16};

struct Way {
  std::string name;
  PlanOptions options;
  bool little_memory = false;  // limits packed weights to half of those of the fastest kernels
  bool is_bf16() const { return options.precision == engine::Precision::kBf16; }
};

bool same_bits(const Values& a, const Values& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const auto& x, const auto& y) {
    const std::vector<float>&p = x.second.values, &q = y.second.values;
    return x.first == y.first && x.second.shape == y.second.shape && p.size() == q.size() &&
           (p.empty() || std::memcmp(p.data(), q.data(), p.size() * sizeof(float)) == 0);
  });
}

class Check {
 public:
  Check(const RandomNet& random_net, Statistics& statistics)
      : random_net_(random_net),
        statistics_(statistics),
        random_(random_net.seed ^ 0x5EED),
        net_((write(random_net, folder_.path()), load())) {
    ways_ = {{"default", {}},
             {"keep_all", {.keep_all = true}},
             {"strict", {.strict_accuracy = true}},
             {"little memory", {}, true},
             {"keep", {.keep = some_layers()}},
             {"bf16", {.precision = engine::Precision::kBf16}},
             {"bf16, keep_all", {.keep_all = true, .precision = engine::Precision::kBf16}}};
    is_gray_ = !random_net.channel_offsets.empty() && net_.takes_single_channel_input();
    if (is_gray_) {
      ways_.push_back({"gray", {.channel_offsets = random_net.channel_offsets}});
      ways_.push_back(
          {"gray, keep_all", {.keep_all = true, .channel_offsets = random_net.channel_offsets}});
      ++statistics.gray;
    }
  }

  std::vector<std::string> some_layers() const {
    std::vector<std::string> names;
    const engine::Plan plan = net_.plan();
    for (size_t i = 0; i < plan.layers().size(); i += 3)
      if (!plan.layers()[i].outputs.empty()) names.push_back(plan.layers()[i].name);
    return names;
  }

  std::string run() {
    ++statistics_.nets;
    statistics_.truncated += !random_net_.end.empty();
    make_cases();
    const bool has_other = cases_.size() > 1;
    statistics_.other_shapes += has_other;
    const int64_t too_large = statistics_.too_large;
    for (const Case& c : cases_) {
      std::string fault = compare_with_reference(c);
      if (!fault.empty()) return fault;
    }
    statistics_.too_large = std::min(statistics_.too_large, too_large + 1);  // count a net once
    // The most expensive plans run with one instruction set only, selected by the seed.
    const std::vector<test::SimdCase> cpus = test::simd_cases();
    const test::SimdCase cpu = cpus[random_net_.seed % cpus.size()];
    const test::ForceSimdCase forced(cpu);
    std::string fault = compare_threads(cases_[0]);
    if (fault.empty() && has_other) fault = compare_beside_each_other();
    return fault.empty() ? "" : str(cpu.name(), ", ", fault);
  }

  void save(const std::filesystem::path& folder) {
    write(random_net_, folder);
    test::write_file(folder / "truncation.txt",
                     str(random_net_.end, "\n", random_net_.graft, "\n"));
    make_cases();
    for (size_t set = 0; set < cases_.size(); ++set)
      save(cases_[set], folder / std::to_string(set));
  }

 private:
  /// Inputs of one set of sizes; `gray` only for a single-channel net.
  struct Case {
    Values full, gray;
    const Values& of(const Way& way) const { return way.options.channel_offsets ? gray : full; }
  };

  void make_cases() {
    const bool has_other = random_net_.sizes[0] != random_net_.sizes[1];
    for (size_t set = 0; set < (has_other ? 2 : 1); ++set) cases_.push_back(inputs_for(set));
  }

  /// Writes inputs, reference outputs and tolerances (float32, without Winograd) for other
  /// programs.
  void save(const Case& c, const std::filesystem::path& folder) const {
    for (const auto& [blob, tensor] : c.full)
      save(folder / ("in_" + blob + ".npy"), tensor.shape.axes(), tensor.values);
    Noise noise{.of_layers = rounding_noise(), .of_weights = weight_lengths()};
    for (const caffe::LayerParameter& layer : random_net_.net.layer())
      if (const double gain = mean_gain(layer); gain > 0)
        noise.of_means[layer.name()] = gain * kMeanNoise;
    Reference reference(net_, c.full, noise);
    if (!reference.is_far_from_overflow()) return;
    for (const auto& [name, tensor] : reference.values()) {
      if (!name.starts_with(kLayer)) continue;
      const std::string port = name.substr(kLayer.size());
      save(folder / (port + ".npy"), tensor.shape.axes(), tensor.values);
      const std::vector<double> off = reference.explained(name);
      save(folder / (port + ".off.npy"), {static_cast<int64_t>(off.size())},
           {off.begin(), off.end()});
    }
  }

  /// Avoids write_npy(), which syncs to disk.
  static void save(const std::filesystem::path& file, const std::vector<int64_t>& shape,
                   const std::vector<float>& values) {
    std::string content = proto::npy_header(shape);
    content.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float));
    test::write_file(file, content);
  }

  Net load(const std::map<std::string, Shape>& inputs = {}) const {
    return Net::load(folder_ / "net.prototxt", folder_ / "net.caffemodel",
                     {.end = random_net_.end, .graft = random_net_.graft, .inputs = inputs});
  }

  Case inputs_for(size_t set) {
    Case result;
    const InputShapes all = input_shapes(random_net_, random_net_.sizes[set]);
    for (const engine::Port& port : net_.inputs()) {
      const Shape& shape = all.shapes.at(port.name);
      Tensor& tensor = result.full[port.name] = {shape, {}};
      const Fill fill = random_net_.inputs.at(port.name).fill;
      tensor.values.resize(static_cast<size_t>(shape.elements()));
      for (size_t i = 0; i < tensor.values.size(); ++i)
        tensor.values[i] = number(fill, i, all.bounds.at(port.name));
      if (is_gray_) make_gray(port.name, result);
    }
    return result;
  }

  float number(Fill fill, size_t i, int64_t bound) {
    switch (fill) {
      case Fill::kIndices:
        return static_cast<float>(random_.between(0, bound - 1));
      case Fill::kFlags:
        return random_.chance(0.6) ? 1 : 0;
      case Fill::kRegions:
        return static_cast<float>(random_.between(0, i % 5 == 0 ? bound - 1 : 20));
      case Fill::kNumbers:
        break;
    }
    return static_cast<float>(random_.real(-1, 1));
  }

  /// Derives the other channels from the first. All sums are exact.
  void make_gray(const std::string& blob, Case& result) const {
    Tensor& full = result.full.at(blob);
    const std::vector<float>& offsets = random_net_.channel_offsets;
    const auto channels = static_cast<size_t>(full.shape[1]);
    const size_t pixels = full.values.size() / channels / static_cast<size_t>(full.shape[0]);
    Tensor& gray = result.gray[blob] = {full.shape.with(1, 1), {}};
    for (size_t i = 0; i < full.values.size(); ++i) {
      const size_t image = i / (pixels * channels), channel = i / pixels % channels;
      const float picture = full.values[image * pixels * channels + i % pixels];
      if (channel == 0)
        gray.values.push_back(picture);
      else
        full.values[i] = picture + offsets[channel];
    }
    for (size_t i = 0; i < full.values.size(); ++i)
      if (i / pixels % channels == 0) full.values[i] += offsets[0];
  }

  static std::map<std::string, Shape> shapes_of(const Case& c) {
    std::map<std::string, Shape> shapes;
    for (const auto& [name, tensor] : c.full) shapes[name] = tensor.shape;
    return shapes;
  }

  PlanOptions options_of(const Case& c, const Way& way, int threads = 1) const {
    PlanOptions options = way.options;
    options.threads = threads;
    if (way.little_memory) options.max_run_bytes = little_memory(c);
    return options;
  }

  Plan plan(const Case& c, const Way& way, int threads = 1) const {
    return net_.plan(shapes_of(c), options_of(c, way, threads));
  }

  /// Returns the default limit if kernels without packed weights need more scratch.
  int64_t little_memory(const Case& c) const {
    const Plan fastest = net_.plan(shapes_of(c));
    const int64_t limit = fastest.arena_bytes() + fastest.packed_weight_bytes() - 1;
    try {
      for (const int threads : kThreads)
        net_.plan(shapes_of(c), {.threads = threads, .max_run_bytes = limit});
      return limit;
    } catch (const InputError&) {
      return PlanOptions{}.max_run_bytes;
    }
  }

  Values run(const Case& c, const Way& way, int threads = 1) const {
    engine::Run run(plan(c, way, threads));
    return forward(run, c.of(way));
  }

  /// Allowed rounding error by layer, in any float32 plan.
  std::map<std::string, double> noise_of(const Case& c) const {
    std::map<std::string, double> noise = rounding_noise();
    test::for_each_simd_target([&] {
      for (const Way& way : ways_) {
        if (way.is_bf16()) continue;
        const Plan planned = plan(c, way);
        for (const engine::LayerCost& layer : planned.layers())
          if (layer.winograd) noise[layer.name] = kWinogradNoise;
      }
    });
    return noise;
  }

  /// Allowed rounding error by layer, without Winograd.
  std::map<std::string, double> rounding_noise() const {
    std::map<std::string, double> noise;
    for (const caffe::LayerParameter& layer : random_net_.net.layer()) {
      if (!rounds(layer)) continue;
      noise[layer.name()] = kNoise;
      if (layer.name() == random_net_.graft)
        noise[random_net_.end + "+" + random_net_.graft] = kNoise;
    }
    return noise;
  }

  /// Average length of an output's weight vector, by layer with weights.
  std::map<std::string, double> weight_lengths() const {
    std::map<std::string, double> lengths;
    for (const caffe::LayerParameter& layer : random_net_.net.layer()) {
      const int64_t outputs = layer.has_convolution_param()
                                  ? layer.convolution_param().num_output()
                                  : layer.inner_product_param().num_output();
      if (outputs == 0 || layer.blobs_size() == 0) continue;
      double squares = 0;
      for (const float weight : layer.blobs(0).data()) squares += double{weight} * weight;
      lengths[layer.name()] = std::sqrt(squares / static_cast<double>(outputs));
    }
    return lengths;
  }

  /// In bfloat16, layers that move NCHWc values round them, too. Decisions are not values.
  std::map<std::string, double> bf16_noise() const {
    const std::set<std::string> decide = {"ArgMax",
                                          "Filter",
                                          "Accuracy",
                                          "DetectionOutput",
                                          "Proposal",
                                          "FrcnnProposal",
                                          "CTCGreedyDecoder",
                                          "BoxOutput",
                                          "BoxGroupOutput",
                                          "YoloDetectionOutput",
                                          "Yolov3DetectionOutput"};
    std::map<std::string, double> noise;
    for (const caffe::LayerParameter& layer : random_net_.net.layer()) {
      if (decide.contains(layer.type())) continue;
      noise[layer.name()] = kBf16Noise;
      if (layer.name() == random_net_.graft)
        noise[random_net_.end + "+" + random_net_.graft] = kBf16Noise;
    }
    return noise;
  }

  std::string compare_with_reference(const Case& c) {
    Reference reference(net_, c.full, {.of_layers = noise_of(c), .of_weights = weight_lengths()}),
        wide(net_, c.full, {bf16_noise(), kBf16Terms});
    int64_t insensitive_in_bf16 = 0;  // not counted, because of cancellation
    if (!reference.is_far_from_overflow()) {
      ++statistics_.too_large;
      return "";
    }
    for (const test::SimdCase& cpu : test::simd_cases()) {
      const test::ForceSimdCase forced(cpu);
      for (const Way& way : ways_) {
        // Options for bfloat16 have no effect in float32.
        if (cpu.bf16 != engine::Instructions::kFloat32 && !way.is_bf16()) continue;
        for (const auto& [name, tensor] : run(c, way)) {
          // A single-channel net's input differs from the reference's.
          if (way.options.channel_offsets && name == kLayer + net_.inputs()[0].name) continue;
          statistics_.outputs += !way.is_bf16();
          const std::string fault = way.is_bf16()
                                        ? wide.compare(name, tensor, insensitive_in_bf16)
                                        : reference.compare(name, tensor, statistics_.insensitive);
          if (!fault.empty())
            return str(cpu.name(), ", ", way.name, ", sizes ", &c - cases_.data(), ": ", fault);
        }
      }
    }
    return "";
  }

  std::string compare_threads(const Case& c) {
    for (const Way& way : ways_) {
      engine::Run one(plan(c, way));
      const Values wanted = forward(one, c.of(way));
      if (!remembers() && !same_bits(forward(one, c.of(way)), wanted))
        return way.name + ": a second pass of the same run gives something else";
      for (const int threads : kThreads)
        if (!same_bits(run(c, way, threads), wanted))
          return str(way.name, ": ", threads, " threads give other bits than one");
      std::vector<Values> within(2);
      parallel_for(2, 2, [&](int64_t i) { within[i] = run(c, way, 3); });
      for (const Values& found : within)
        if (!same_bits(found, wanted))
          return way.name + ": within two threads, a run on three gives other bits than on one";
    }
    return "";
  }

  bool remembers() const {
    return std::any_of(
        random_net_.net.layer().begin(), random_net_.net.layer().end(), [](const auto& layer) {
          return layer.type() == "LSTM" || layer.type() == "RNN" || layer.type() == "Lstm" ||
                 layer.dropout_param().sample_weights_test();
        });
  }

  std::string compare_beside_each_other() {
    const Net loaded = load(shapes_of(cases_[1]));
    for (const Way& way : ways_) {
      std::vector<Values> alone;
      for (const Case& c : cases_) alone.push_back(run(c, way));
      engine::Run at_once(loaded.plan({}, options_of(cases_[1], way)));
      if (!same_bits(forward(at_once, cases_[1].of(way)), alone[1]))
        return way.name + ": shapes given when loading and when planning give different bits";
      for (const size_t first : {0, 1}) {
        const size_t second = 1 - first;
        engine::Run a(plan(cases_[first], way)), b(plan(cases_[second], way));
        if (!same_bits(forward(b, cases_[second].of(way)), alone[second]) ||
            !same_bits(forward(a, cases_[first].of(way)), alone[first]))
          return str(way.name, ": a plan for sizes ", first, " and then one for sizes ", second,
                     " do not give what each gives alone");
      }
    }
    return "";
  }

  const RandomNet& random_net_;
  Statistics& statistics_;
  Random random_;
  const test::TempDir folder_;
  Net net_;
  std::vector<Way> ways_;
  bool is_gray_ = false;
  std::vector<Case> cases_;
};

}  // namespace

std::string find_fault(const RandomNet& net, Statistics& statistics) {
  return Check(net, statistics).run();
}

std::string find_fault(uint64_t seed, Statistics& statistics) {
  const RandomNet net = make_random_net(seed);
  try {
    const std::string fault = find_fault(net, statistics);
    return fault.empty() ? "" : str("seed ", seed, ": ", fault, "\n", text_of(net));
  } catch (const Error& error) {
    return str("seed ", seed, ": refused: ", error.what(), "\n", text_of(net));
  }
}

void save(uint64_t seed, const std::filesystem::path& folder) {
  const RandomNet net = make_random_net(seed);
  Statistics ignored;
  Check(net, ignored).save(folder);
}

}  // namespace revisit::random_nets
