// Primitives of oneDNN 2, in the memory layouts that its convolutions request.
#include <omp.h>

#include <algorithm>
#include <chrono>
#include <dnnl.hpp>
#include <limits>
#include <thread>
#include <unordered_map>

#include "layers/convolution.h"
#include "layers/pooling_window.h"
#include "operations.h"
#include "subject.h"

namespace revisit::bench {
namespace {

using dnnl::memory;
using engine::Shape;
using Arguments = std::unordered_map<int, memory>;

memory::desc descriptor(memory::dims dims, memory::format_tag tag) {
  return {std::move(dims), memory::data_type::f32, tag};
}

memory::format_tag plain_tag(size_t rank) {
  constexpr memory::format_tag kTags[] = {memory::format_tag::a, memory::format_tag::ab,
                                          memory::format_tag::abc, memory::format_tag::abcd,
                                          memory::format_tag::abcde};
  return kTags[rank - 1];
}

memory::desc plain(const memory::dims& dims) {
  return descriptor(dims, plain_tag(dims.size()));
}
memory::desc any(const memory::dims& dims) {
  return descriptor(dims, memory::format_tag::any);
}

struct Step {
  dnnl::primitive primitive;
  Arguments arguments;
};

class OneDnn : public Subject {
 public:
  OneDnn(const Model& model, const Setting& setting, std::span<const float> input)
      : model_(model),
        setting_(setting),
        engine_(dnnl::engine::kind::cpu, 0),
        stream_(engine_),
        values_(model.values.size()) {
    omp_set_num_threads(setting.threads);
    memory::dims dims = model.input().axes();
    if (setting.gray) dims[1] = 1;
    input_ = memory(plain(dims), engine_);
    std::copy_n(input.data(), input_.get_desc().get_size() / sizeof(float), data(input_));
    values_[0] = input_;
    for (const Operation& operation : fold(model, setting.gray)) add(operation);
    const memory result = values_[last_value_];
    output_ = reordered(result, plain(result.get_desc().dims()));
  }

  std::string name() const override {
    const dnnl_version_t* v = dnnl_version();
    return str("oneDNN ", v->major, ".", v->minor, ".", v->patch);
  }

  void forward() override {
    omp_set_num_threads(setting_.threads);
    for (const Step& step : steps_) step.primitive.execute(stream_, step.arguments);
    stream_.wait();
  }

  std::span<const float> output() const override {
    return {static_cast<const float*>(output_.get_data_handle()),
            output_.get_desc().get_size() / sizeof(float)};
  }

  std::vector<double> timed_forward() override {
    omp_set_num_threads(setting_.threads);
    std::vector<double> times;
    for (const Step& step : steps_) times.push_back(time_of(step));
    return times;
  }

 private:
  static float* data(memory& m) { return static_cast<float*>(m.get_data_handle()); }

  double time_of(const Step& step) {
    const double start = now_ms();
    step.primitive.execute(stream_, step.arguments);
    stream_.wait();
    return now_ms() - start;
  }

  memory packed(const std::vector<float>& values, const memory::dims& dims,
                const memory::desc& wanted) {
    memory from(plain(dims), engine_), to(wanted, engine_);
    std::copy(values.begin(), values.end(), data(from));
    dnnl::reorder(from, to).execute(stream_, from, to);
    stream_.wait();
    return to;
  }

  Step reorder_step(memory from, const memory::desc& wanted) {
    const memory to(wanted, engine_);
    return {dnnl::reorder(from, to), {{DNNL_ARG_FROM, from}, {DNNL_ARG_TO, to}}};
  }

  /// Adds a reorder step if the layout differs.
  memory reordered(const memory& value, const memory::desc& wanted) {
    if (value.get_desc() == wanted) return value;
    steps_.push_back(reorder_step(value, wanted));
    return steps_.back().arguments.at(DNNL_ARG_TO);
  }

  /// Runs the added steps: the next layer is chosen by timing and needs real values.
  void add(const Operation& operation) {
    const size_t first = steps_.size();
    append(operation);
    for (size_t i = first; i < steps_.size(); ++i)
      steps_[i].primitive.execute(stream_, steps_[i].arguments);
    stream_.wait();
    last_value_ = operation.output;
  }

  void append(const Operation& operation) {
    static const std::unordered_map<std::string, void (OneDnn::*)(const Operation&)> kAdd = {
        {"Convolution", &OneDnn::add_convolution},
        {"LRN", &OneDnn::add_lrn},
        {"Pooling", &OneDnn::add_pooling},
        {"ReLU", &OneDnn::add_relu},
        {"Concat", &OneDnn::add_concat},
        {"Softmax", &OneDnn::add_softmax},
        {"InnerProduct", &OneDnn::add_inner_product}};
    const std::string& type = operation.layer->param.type();
    if (!kAdd.contains(type)) throw UnsupportedError(str("oneDNN: no layer type ", type));
    (this->*kAdd.at(type))(operation);
  }

  template <class Primitive, class Descriptor>
  void add_step(const Operation& operation, const Descriptor& pd, Arguments arguments) {
    const memory result(pd.dst_desc(), engine_);
    arguments[DNNL_ARG_DST] = result;
    values_[operation.output] = result;
    steps_.push_back({Primitive(pd), std::move(arguments)});
  }

  struct Convolution {
    memory::dims in, out, weights, bias, stride, dilation, pad, pad_end;
  };

  Convolution shape_of(const Operation& operation) {
    const auto& param = operation.layer->param.convolution_param();
    const Shape& out = model_.values[operation.layer->outputs[0]];
    Convolution c;
    c.in = values_[operation.inputs[0]].get_desc().dims();
    c.out = out.axes();
    c.bias = {c.out[1]};
    const int64_t group = param.group();
    c.weights = {c.out[1] / group, c.in[1] / group};
    if (group > 1) c.weights.insert(c.weights.begin(), group);
    engine::WindowAxes axes = engine::window_axes(param, 2);
    for (size_t i = 0; i < axes.size(); ++i) {
      const engine::WindowAxis& axis = axes[i];
      c.weights.push_back(axis.kernel);
      c.stride.push_back(axis.stride);
      c.dilation.push_back(axis.dilation - 1);
      c.pad.push_back(axis.pad);
      const int64_t reach =
          (c.out[i + 2] - 1) * axis.stride + axis.dilation * (axis.kernel - 1) + 1;
      c.pad_end.push_back(reach - c.in[i + 2] - axis.pad);
    }
    return c;
  }

  static dnnl::primitive_attr attributes(const Operation& operation) {
    dnnl::post_ops after;
    if (operation.addend) after.append_sum(1);
    if (operation.relu) after.append_eltwise(1, dnnl::algorithm::eltwise_relu, *operation.relu, 0);
    dnnl::primitive_attr result;
    result.set_post_ops(after);
    return result;
  }

  using ConvolutionDescriptor = dnnl::convolution_forward::primitive_desc;

  /// Excludes reference implementations.
  std::vector<ConvolutionDescriptor> candidates(const Operation& operation, const Convolution& c) {
    std::vector<ConvolutionDescriptor> found;
    const memory::desc out = operation.addend ? values_[*operation.addend].get_desc() : any(c.out);
    for (const auto algorithm :
         {dnnl::algorithm::convolution_direct, dnnl::algorithm::convolution_winograd}) {
      try {
        const dnnl::convolution_forward::desc d(dnnl::prop_kind::forward_inference, algorithm,
                                                any(c.in), any(c.weights), any(c.bias), out,
                                                c.stride, c.dilation, c.pad, c.pad_end);
        ConvolutionDescriptor pd(d, attributes(operation), engine_);
        do {
          const std::string how = pd.impl_info_str();
          if (how.find("ref") == std::string::npos) found.push_back(pd);
        } while (pd.next_impl());
      } catch (const dnnl::error&) {
      }
    }
    if (found.empty())
      throw UnsupportedError(str("oneDNN: no convolution for ", operation.layer->param.name()));
    return found;
  }

  std::vector<Step> steps_of(const Operation& operation, const Convolution& c,
                             const ConvolutionDescriptor& pd) {
    std::vector<Step> steps;
    memory in = values_[operation.inputs[0]];
    if (in.get_desc() != pd.src_desc()) {
      steps.push_back(reorder_step(in, pd.src_desc()));
      in = steps.back().arguments.at(DNNL_ARG_TO);
    }
    const memory out =
        operation.addend ? values_[*operation.addend] : memory(pd.dst_desc(), engine_);
    steps.push_back({dnnl::convolution_forward(pd),
                     {{DNNL_ARG_SRC, in},
                      {DNNL_ARG_WEIGHTS, packed(operation.weights, c.weights, pd.weights_desc())},
                      {DNNL_ARG_BIAS, packed(operation.bias, c.bias, pd.bias_desc())},
                      {DNNL_ARG_DST, out}}});
    return steps;
  }

  double time_of(const std::vector<Step>& steps) {
    double sum = 0;
    for (const Step& step : steps) sum += time_of(step);
    return sum;
  }

  /// Times candidates in turn, so that load affects all alike. Skips candidates that take twice as
  /// long as another in the best of three rounds.
  void add_convolution(const Operation& operation) {
    constexpr int kRounds = 30, kRoundsOfAll = 3;
    constexpr auto kPause = std::chrono::milliseconds(1);
    const Convolution c = shape_of(operation);
    std::vector<std::vector<Step>> all;
    for (const ConvolutionDescriptor& pd : candidates(operation, c))
      all.push_back(steps_of(operation, c, pd));
    std::vector<double> least_ms(all.size(), std::numeric_limits<double>::infinity());
    for (int round = 0; round < kRounds && all.size() > 1; ++round)
      for (size_t i = 0; i < all.size(); ++i) {
        if (round >= kRoundsOfAll && least_ms[i] > 2 * *std::ranges::min_element(least_ms))
          continue;
        std::this_thread::sleep_for(kPause);
        least_ms[i] = std::min(least_ms[i], time_of(all[i]));
      }
    std::vector<Step>& best =
        all[std::min_element(least_ms.begin(), least_ms.end()) - least_ms.begin()];
    values_[operation.output] = best.back().arguments.at(DNNL_ARG_DST);
    for (Step& step : best) steps_.push_back(std::move(step));
  }

  void add_lrn(const Operation& operation) {
    const auto& param = operation.layer->param.lrn_param();
    const memory in = values_[operation.inputs[0]];
    const dnnl::lrn_forward::primitive_desc pd(
        {dnnl::prop_kind::forward_inference, dnnl::algorithm::lrn_across_channels, in.get_desc(),
         param.local_size(), param.alpha(), param.beta(), param.k()},
        engine_);
    add_step<dnnl::lrn_forward>(operation, pd, {{DNNL_ARG_SRC, in}});
  }

  void add_pooling(const Operation& operation) {
    const engine::PoolingWindow window(operation.layer->param.pooling_param());
    const memory in = values_[operation.inputs[0]];
    const memory::dims dims = in.get_desc().dims();
    const engine::PoolingProblem p = window.problem(Shape(dims));
    const memory::dims pad_end = {(p.out_h - 1) * p.stride_h + p.kernel_h - p.h - p.pad_h,
                                  (p.out_w - 1) * p.stride_w + p.kernel_w - p.w - p.pad_w};
    if (!window.is_max() && (pad_end[0] > p.pad_h || pad_end[1] > p.pad_w))
      throw UnsupportedError("oneDNN: no average over windows that reach beyond the padding");
    const dnnl::pooling_forward::primitive_desc pd(
        {dnnl::prop_kind::forward_inference,
         window.is_max() ? dnnl::algorithm::pooling_max
                         : dnnl::algorithm::pooling_avg_include_padding,
         in.get_desc(),
         any({dims[0], dims[1], p.out_h, p.out_w}),
         {p.stride_h, p.stride_w},
         {p.kernel_h, p.kernel_w},
         {p.pad_h, p.pad_w},
         pad_end},
        engine_);
    add_step<dnnl::pooling_forward>(operation, pd, {{DNNL_ARG_SRC, in}});
  }

  void add_relu(const Operation& operation) {
    const memory in = values_[operation.inputs[0]];
    const dnnl::eltwise_forward::primitive_desc pd(
        {dnnl::prop_kind::forward_inference, dnnl::algorithm::eltwise_relu, in.get_desc(),
         operation.layer->param.relu_param().negative_slope()},
        engine_);
    add_step<dnnl::eltwise_forward>(operation, pd, {{DNNL_ARG_SRC, in}});
  }

  void add_concat(const Operation& operation) {
    std::vector<memory::desc> parts;
    Arguments arguments;
    for (size_t i = 0; i < operation.inputs.size(); ++i) {
      const memory part = values_[operation.inputs[i]];
      parts.push_back(part.get_desc());
      arguments[DNNL_ARG_MULTIPLE_SRC + static_cast<int>(i)] = part;
    }
    constexpr int kChannels = 1;
    add_step<dnnl::concat>(operation, dnnl::concat::primitive_desc(kChannels, parts, engine_),
                           std::move(arguments));
  }

  void add_inner_product(const Operation& operation) {
    memory in = values_[operation.inputs[0]];
    const memory::dims dims = in.get_desc().dims();
    const auto n = static_cast<int64_t>(operation.bias.size());
    memory::dims weights = dims;
    weights[0] = n;
    const dnnl::inner_product_forward::primitive_desc pd(
        {dnnl::prop_kind::forward_inference, any(dims), any(weights), any({n}), any({dims[0], n})},
        attributes(operation), engine_);
    in = reordered(in, pd.src_desc());
    add_step<dnnl::inner_product_forward>(
        operation, pd,
        {{DNNL_ARG_SRC, in},
         {DNNL_ARG_WEIGHTS, packed(operation.weights, weights, pd.weights_desc())},
         {DNNL_ARG_BIAS, packed(operation.bias, {n}, pd.bias_desc())}});
  }

  void add_softmax(const Operation& operation) {
    const memory in = values_[operation.inputs[0]];
    constexpr int kChannels = 1;
    const dnnl::softmax_forward::primitive_desc pd(
        {dnnl::prop_kind::forward_inference, in.get_desc(), kChannels}, engine_);
    add_step<dnnl::softmax_forward>(operation, pd, {{DNNL_ARG_SRC, in}});
  }

  const Model& model_;
  Setting setting_;
  dnnl::engine engine_;
  dnnl::stream stream_;
  std::vector<memory> values_;
  std::vector<Step> steps_;
  memory input_, output_;
  size_t last_value_ = 0;
};

}  // namespace

std::unique_ptr<Subject> make_onednn(const Model& model, const Setting& setting,
                                     std::span<const float> input) {
  return std::make_unique<OneDnn>(model, setting, input);
}

}  // namespace revisit::bench
