#include <algorithm>

#include "builder.h"
#include "revisit/base/error.h"

namespace revisit::random_nets {
namespace {

using engine::Shape;
using Ids = std::vector<size_t>;

const std::vector<int64_t> kWidths{1, 2, 3, 4, 5, 7, 8, 10, 15, 16, 16, 17, 24, 32, 32, 33, 48, 64};

int64_t signed_rank(const Shape& shape) {
  return static_cast<int64_t>(shape.rank());
}

int64_t random_axis(Builder& b, const Shape& shape, int64_t first = 0) {
  if (signed_rank(shape) <= first) throw Unfit();
  const int64_t axis = b.random.between(first, signed_rank(shape) - 1);
  return b.random.chance(0.3) ? axis - signed_rank(shape) : axis;
}

std::string flag(Builder& b) {
  return b.random.chance(0.5) ? "true" : "false";
}

size_t extra_input(Builder& b, const Input& input) {
  if (!b.takes_inputs) throw Unfit();
  return b.add_input(input, input.fill != Fill::kNumbers);
}

std::vector<Size> axes_of(Builder& b, size_t id, size_t first, size_t last) {
  std::vector<Size> axes;
  for (size_t axis = first; axis < last; ++axis) axes.push_back(b.axis_of(id, axis));
  return axes;
}

std::vector<Size> all_axes(Builder& b, size_t id) {
  return axes_of(b, id, 0, b.shape(id).rank());
}

void elementwise(Builder& b, const char* type) {
  b.add(type, {b.any()});
}

void dropout(Builder& b, const char* type) {
  const std::string ratio = str("dropout_ratio: ", b.random.real(0.1, 0.9));
  const std::string option = b.random.chance(0.5)   ? ""
                             : b.random.chance(0.5) ? " scale_train: false"
                                                    : " sample_weights_test: true";
  b.add(type, {b.any()}, "dropout_param { " + ratio + option + " }");
}

void clip(Builder& b, const char* type) {
  b.add(type, {b.any()},
        str("clip_param { min: ", b.random.real(-2, 0), " max: ", b.random.real(0, 2), " }"));
}

void elu(Builder& b, const char* type) {
  b.add(type, {b.any()}, str("elu_param { alpha: ", b.random.real(-1, 2), " }"));
}

/// Limits values, so that they do not overflow.
void exp(Builder& b, const char* type) {
  const size_t x = b.add("Clip", {b.any()}, "clip_param { min: -4 max: 4 }");
  b.add(type, {x},
        str("exp_param { base: ", b.random.chance(0.5) ? "-1" : "2",
            " scale: ", b.random.real(-1, 1), " shift: ", b.random.real(-1, 1), " }"));
}

size_t positive(Builder& b) {
  return b.add(b.random.chance(0.5) ? "AbsVal" : "Sigmoid", {b.any()});
}

void log(Builder& b, const char* type) {
  b.add(type, {positive(b)},
        str("log_param { base: ", b.random.chance(0.5) ? "-1" : "10",
            " scale: ", b.random.real(0.5, 2), " shift: ", b.random.real(0.1, 1), " }"));
}

void power(Builder& b, const char* type) {
  static const std::vector<double> kWhole{0, 1, 1, 1, 2, 3}, kOthers{0.5, -1, 1.5, -0.5};
  const bool whole = b.random.chance(0.7);
  const double power = b.random.of(whole ? kWhole : kOthers);
  b.add(type, {whole ? b.any() : positive(b)},
        str("power_param { power: ", power, " scale: ", b.random.real(whole ? -2 : 0.25, 2),
            " shift: ", b.random.real(whole ? -1 : 0.25, 1), " }"));
}

void prelu(Builder& b, const char* type) {
  b.add(type, {b.of_rank(2)}, str("prelu_param { channel_shared: ", flag(b), " }"));
}

void relu(Builder& b, const char* type) {
  b.add(
      type, {b.any()},
      b.random.chance(0.7) ? "" : str("relu_param { negative_slope: ", b.random.real(-1, 1), " }"));
}

void relu6(Builder& b, const char* type) {
  b.add(
      type, {b.any()},
      b.random.chance(0.7) ? "" : str("relu6_param { negative_slope: ", b.random.real(0, 1), " }"));
}

void swish(Builder& b, const char* type) {
  b.add(type, {b.any()}, str("swish_param { beta: ", b.random.real(-2, 2), " }"));
}

void threshold(Builder& b, const char* type) {
  b.add(type, {b.exact()}, str("threshold_param { threshold: ", b.random.real(-1, 1), " }"));
}

/// `outputs` sets num_output and group.
void convolve(Builder& b, const char* type, size_t x, int64_t axis, const std::string& outputs) {
  const auto n_axes = static_cast<size_t>(signed_rank(b.shape(x)) - axis - 1);
  Ids inputs{x};
  while (b.random.chance(0.08)) inputs.push_back(b.same_shape(x));  // with the same weights
  b.add(type, inputs,
        str("convolution_param { ", outputs,
            " axis: ", b.random.chance(0.2) ? axis - signed_rank(b.shape(x)) : axis,
            b.random.chance(0.3) ? " bias_term: false " : " ", random_windows(b.random, n_axes),
            " }"),
        inputs.size());
}

/// The number of groups divides channels and outputs.
std::string groups_and_outputs(Builder& b, int64_t channels) {
  int64_t group = 1;
  if (b.random.chance(0.3)) {
    std::vector<int64_t> divisors;
    for (int64_t d = 1; d <= channels; ++d)
      if (channels % d == 0) divisors.push_back(d);
    group = b.random.of(divisors);
  }
  const int64_t outputs = group > 1 ? group * b.random.between(1, 3) : b.random.of(kWidths);
  return str("num_output: ", outputs, " group: ", group);
}

void convolution(Builder& b, const char* type) {
  const bool image = b.random.chance(0.8);
  const size_t x = image ? b.of_rank(4, 4) : b.of_rank(2, 5);
  const int64_t axis =
      image || b.random.chance(0.7) ? 1 : b.random.between(0, signed_rank(b.shape(x)) - 1);
  convolve(b, type, x, axis, groups_and_outputs(b, b.shape(x)[static_cast<size_t>(axis)]));
}

/// The default of `group` is the number of channels.
void depthwise_convolution(Builder& b, const char* type) {
  const size_t x = b.of_rank(3, 5);
  convolve(b, type, x, 1, str("num_output: ", b.shape(x)[1] * b.random.between(1, 2)));
}

void convolution_depthwise(Builder& b, const char* type) {
  const size_t x = b.of_rank(3, 5);
  convolve(b, type, x, 1, str("num_output: ", b.shape(x)[1]));
}

void im2col(Builder& b, const char* type) {
  const size_t x = b.of_rank(3, 5);
  b.add(type, {x},
        str("convolution_param { ", random_windows(b.random, b.shape(x).rank() - 2), " }"));
}

void inner_product(Builder& b, const char* type) {
  const size_t x = b.of_rank(1);
  b.add(type, {x},
        str("inner_product_param { num_output: ", b.random.of(kWidths),
            " axis: ", random_axis(b, b.shape(x), b.shape(x).rank() > 1 ? 1 : 0),
            " transpose: ", flag(b), " bias_term: ", flag(b), " }"));
}

void embed(Builder& b, const char* type) {
  const int64_t rows = b.random.between(1, 9);
  const size_t indices =
      extra_input(b, {{{1, 0}, {b.random.between(1, 6)}}, Fill::kIndices, {rows}});
  b.add(type, {indices},
        str("embed_param { input_dim: ", rows, " num_output: ", b.random.of(kWidths),
            " bias_term: ", flag(b), " }"));
}

void recurrent(Builder& b, const char* type) {
  const size_t x = b.of_rank(3);
  Ids inputs{x, extra_input(b, {axes_of(b, x, 0, 2), Fill::kFlags})};
  const int64_t outputs = b.random.between(1, 9), streams = b.shape(x)[1];
  if (b.random.chance(0.3))
    inputs.push_back(
        b.pick([&](const Value& v) { return v.shape.rank() >= 2 && v.shape[0] == streams; }));
  const bool exposes = b.random.chance(0.3);
  size_t states = 0;
  for (; exposes && states < (std::string(type) == "LSTM" ? 2 : 1); ++states)
    inputs.push_back(extra_input(b, {{{1}, b.axis_of(x, 1), {outputs}}}));
  b.add(type, inputs,
        str("recurrent_param { num_output: ", outputs, " expose_hidden: ", exposes ? 1 : 0, " }"),
        1 + states);
}

void rows_lstm(Builder& b, const char* type) {
  const size_t x = b.of_rank(2);
  const bool rows = b.shape(x).rank() == 2;
  std::string batch;
  if (rows && b.random.chance(0.5)) batch = str(" batch_size: ", b.shape(x)[0] % 2 == 0 ? 2 : 1);
  Ids inputs{x};
  if (b.random.chance(0.4)) {  // a clip of a value for each step and stream
    std::vector<Size> axes{b.axis_of(x, 0)};
    if (!rows) axes[0].axes.push_back(b.axis_of(x, 1).axes[0]);
    inputs.push_back(extra_input(b, {axes, Fill::kFlags}));
  }
  b.add(type, inputs, str("lstm_param { num_output: ", b.random.between(1, 9), batch, " }"));
}

void batch_norm(Builder& b, const char* type) {
  b.add(type, {b.of_rank(2)},
        b.random.chance(0.6)   ? ""
        : b.random.chance(0.5) ? "batch_norm_param { scale_bias: true }"
                               : "batch_norm_param { use_global_stats: false }");
}

/// Fields of PSPNet, or of SegNet with stored or batch statistics.
void bn(Builder& b, const char* type) {
  b.add(type, {b.of_rank(2)},
        b.random.chance(0.5)   ? ""
        : b.random.chance(0.6) ? "bn_param { bn_mode: INFERENCE }"
                               : "bn_param { bn_mode: LEARN }");
}

void lrn(Builder& b, const char* type) {
  b.add(type, {b.of_rank(4, 4)},
        str("lrn_param { local_size: ", 2 * b.random.between(0, 3) + 1,
            " alpha: ", b.random.real(0, 2), " beta: ", b.random.chance(0.6) ? 0.75 : 0.5,
            " k: ", b.random.real(1, 2),
            " norm_region: ", b.random.chance(0.7) ? "ACROSS_CHANNELS" : "WITHIN_CHANNEL", " }"));
}

void mvn(Builder& b, const char* type) {
  b.add(type, {b.of_rank(0, 4)},
        str("mvn_param { normalize_variance: ", flag(b), " across_channels: ", flag(b),
            " eps: 0.01 }"));
}

void normalize(Builder& b, const char* type) {
  b.add(type, {b.of_rank(2)},
        str("norm_param { across_spatial: ", flag(b), " channel_shared: ", flag(b), " }"));
}

void softmax(Builder& b, const char* type) {
  const size_t x = b.of_rank(1);
  b.add(type, {x}, str("softmax_param { axis: ", random_axis(b, b.shape(x)), " }"));
}

std::string pads_of_sides(Random& random, int64_t most) {
  std::string text;
  for (const char* side : {" pad_l: ", " pad_r: ", " pad_t: ", " pad_b: "})
    text += side + std::to_string(random.between(0, most));
  return text;
}

void pooling(Builder& b, const char* type) {
  const size_t x = b.of_rank(4, 5);
  const bool max = b.random.chance(0.7);
  std::string text = max                    ? "pool: MAX "
                     : b.random.chance(0.7) ? "pool: AVE "
                                            : "pool: AVE_EXC_PAD ";
  if (b.random.chance(0.2)) {
    text += "global_pooling: true";
  } else {
    const int64_t kernel = b.random.between(1, 4);
    text += str("kernel_size: ", kernel, " stride: ", b.random.between(1, 3));
    if (b.shape(x).rank() == 4 && b.random.chance(0.2))
      text += pads_of_sides(b.random, kernel - 1);
    else
      text += str(" pad: ", b.random.chance(0.6) ? 0 : b.random.between(0, kernel - 1));
    if (b.random.chance(0.3)) text += " round_mode: FLOOR";
  }
  b.add(type, {x}, "pooling_param { " + text + " }",
        max && b.value(x).exact && b.random.chance(0.15) ? 2 : 1);
}

void spp(Builder& b, const char* type) {
  b.add(type, {b.of_rank(4, 4)},
        str("spp_param { pyramid_height: ", b.random.between(1, 3),
            " pool: ", b.random.chance(0.5) ? "MAX" : "AVE", " }"));
}

size_t regions_of(Builder& b, size_t x) {
  return extra_input(b, {{{b.random.between(1, 4)}, {5}}, Fill::kRegions, b.axis_of(x, 0)});
}

size_t pool_regions(Builder& b, const char* type, size_t x, size_t regions) {
  return b.add(type, {x, regions},
               str("roi_pooling_param { pooled_h: ", b.random.between(1, 3),
                   " pooled_w: ", b.random.between(1, 3), " spatial_scale: 0.5",
                   b.random.chance(0.3) ? " pad_ratio: 0.25 }" : " }"));
}

void roi_pooling(Builder& b, const char* type) {
  const size_t x = b.of_rank(4, 4);
  pool_regions(b, type, x, regions_of(b, x));
}

void psroi_pooling(Builder& b, const char* type) {
  const size_t x = b.of_rank(4, 4);
  const int64_t channels = b.shape(x)[1], group = channels % 4 == 0 ? 2 : 1;
  const bool has_object = std::string(type) == "PSROIContextPooling";
  std::vector<size_t> inputs{x, regions_of(b, x)};
  if (has_object) inputs.push_back(regions_of(b, x));
  b.add(type, inputs,
        str(has_object ? "psroi_context_pooling_param" : "psroi_pooling_param",
            " { spatial_scale: 0.5 output_dim: ", channels / (group * group),
            " group_size: ", group, " }"));
}

void compute_rows(Builder& b, size_t rows) {
  static const std::vector<std::string> kTypes{"ReLU", "TanH", "Softmax"};
  const size_t sums = b.add("InnerProduct", {rows}, "inner_product_param { num_output: 3 }");
  b.add(b.random.of(kTypes), {sums});
}

void proposal(Builder& b, const char* type) {
  const int64_t ratios = b.random.between(1, 2), scales = b.random.between(1, 2);
  const Size anchors2{2 * ratios * scales}, anchors4{4 * ratios * scales};
  const Size h{b.random.between(1, 4)}, w{b.random.between(1, 4)};
  const size_t scores = extra_input(b, {{{1}, anchors2, h, w}}),
               offsets = extra_input(b, {{{1}, anchors4, h, w}});
  // Height, width and scale are one number, so that few regions are large where any must be.
  const size_t image = b.add("DummyData", {},
                             str("dummy_data_param { shape { dim: 1 dim: 3 } data_filler { value: ",
                                 b.random.between(6, 20), " } }"));
  const size_t regions = b.add(
      type, {scores, offsets, image},
      str("proposal_param { feat_stride: ", b.random.between(1, 6), " base_size: 4 min_size: ",
          b.random.between(0, 1), " ratio: 1 scale: 1 ", ratios > 1 ? "ratio: 2 " : "",
          scales > 1 ? "scale: 3 " : "", "pre_nms_topn: ", b.random.between(1, 40),
          " post_nms_topn: ", b.random.between(1, 9), " nms_thresh: ", b.random.real(0.1, 0.9),
          " }", b.random.chance(0.5) ? " python_param { }" : ""),
      b.random.chance(0.3) ? 2 : 1);
  if (b.random.chance(0.7))
    compute_rows(b, pool_regions(b, "ROIPooling", b.of_rank(4, 4), regions));
}

void frcnn_proposal(Builder& b, const char* type) {
  const Size h{b.random.between(1, 4)}, w{b.random.between(1, 4)};
  const size_t scores = extra_input(b, {{{1}, {4}, h, w}}),
               offsets = extra_input(b, {{{1}, {8}, h, w}});
  const size_t image = b.add("DummyData", {},
                             "dummy_data_param { shape { dim: 1 dim: 3 } "
                             "data_filler { value: 12 } }");
  b.add(type, {scores, offsets, image},
        str("proposal_param { feat_stride: 3 min_size: ", b.random.between(0, 1),
            " anchor: [-2, -2, 5, 6, 0, 0, 3, 3] post_nms_topn: ", b.random.between(1, 9), " }"));
}

void continuation_indicator(Builder& b, const char* type) {
  b.add(type, {},
        str("continuation_indicator_param { time_step: ", b.random.between(1, 5),
            " batch_size: ", b.random.between(1, 3), " }"));
}

void ctc_greedy_decoder(Builder& b, const char* type) {
  const size_t x = b.pick([](const Value& v) { return v.exact && v.shape.rank() == 3; });
  b.add(type, {x},
        str("ctc_decoder_param { blank_index: ", b.random.between(-1, 0),
            " ctc_merge_repeated: ", flag(b), " }"),
        b.random.chance(0.5) ? 2 : 1);
}

void reduction(Builder& b, const char* type) {
  static const std::vector<std::string> kOperations{"SUM", "ASUM", "SUMSQ", "MEAN"};
  const size_t x = b.of_rank(1);
  b.add(type, {x},
        str("reduction_param { operation: ", b.random.of(kOperations),
            " axis: ", random_axis(b, b.shape(x)), " coeff: ", b.random.real(-2, 2), " }"));
}

void eltwise(Builder& b, const char* type) {
  static const std::vector<std::string> kOperations{"PROD", "SUM", "SUM", "SUM", "MAX"};
  Ids inputs{b.any()};
  do inputs.push_back(b.same_shape(inputs[0]));
  while (b.random.chance(0.3));
  if (b.random.chance(0.5)) std::swap(inputs[0], inputs[1]);
  const std::string& operation = b.random.of(kOperations);
  std::string text = "operation: " + operation;
  if (operation == "SUM" && b.random.chance(0.3))
    for (size_t i = 0; i < inputs.size(); ++i) text += str(" coeff: ", b.random.real(-2, 2));
  b.add(type, inputs, "eltwise_param { " + text + " }");
}

std::string shape_text(const std::vector<int64_t>& axes) {
  std::string text = "shape {";
  for (const int64_t size : axes) text += str(" dim: ", size);
  return text + " }";
}

/// Axes [first, last) of blob `id`.
struct Range {
  size_t id, first, last;
};

/// Picks another value that fits some axes of x when reshaped, preferably a large one. For a Concat
/// that is often one of its parts, which may share its memory.
Range operand_of(Builder& b, size_t x) {
  const Shape& shape = b.shape(x);
  std::vector<Range> fitting, largest;
  for (size_t id = 0; id < b.n_values(); ++id)
    for (size_t first = 0; first < shape.rank(); ++first)
      for (size_t last = first + 1; last <= shape.rank(); ++last) {
        const Value& value = b.value(id);
        const int64_t elements = value.shape.elements();
        if (id == x || value.dynamic || value.hidden || shape.product(first, last) != elements)
          continue;
        fitting.push_back({id, first, last});
        if (!largest.empty() && b.shape(largest[0].id).elements() < elements) largest.clear();
        if (largest.empty() || b.shape(largest[0].id).elements() == elements)
          largest.push_back(fitting.back());
      }
  if (fitting.empty()) throw Unfit();
  return b.random.of(b.random.chance(0.6) ? largest : fitting);
}

std::string param_of(const std::string& type) {
  return type == "Scale" ? "scale_param" : "bias_param";
}

void scale_or_bias_by_value(Builder& b, const char* type, size_t x) {
  const Range range = operand_of(b, x);
  const std::vector<int64_t>& axes = b.shape(x).axes();
  const std::vector<int64_t> wanted(axes.begin() + static_cast<int64_t>(range.first),
                                    axes.begin() + static_cast<int64_t>(range.last));
  size_t operand = range.id;
  if (b.shape(operand).axes() != wanted)
    operand = b.add("Reshape", {operand}, "reshape_param { " + shape_text(wanted) + " }");
  b.add(type, {x, operand}, str(param_of(type), " { axis: ", range.first, " }"));
}

void scale_or_bias(Builder& b, const char* type) {
  const size_t x = b.of_rank(1);
  if (b.random.chance(0.5)) return scale_or_bias_by_value(b, type, x);
  const auto rank = signed_rank(b.shape(x));
  const int64_t axis = rank > 1 && b.random.chance(0.7) ? 1 : b.random.between(0, rank - 1);
  const int64_t num_axes = b.random.chance(0.6) ? 1 : b.random.between(-1, rank - axis);
  const bool with_bias = param_of(type) == "scale_param" && b.random.chance(0.5);
  b.add(type, {x},
        str(param_of(type), " { axis: ", axis, " num_axes: ", num_axes,
            with_bias ? " bias_term: true }" : " }"));
}

/// The factors are a value of the right size, or made of x by global pooling, as in SENet.
void axpy(Builder& b, const char* type) {
  const size_t x = b.of_rank(2), y = b.same_shape(x);
  const Shape shape = b.shape(x);
  size_t factors = 0;
  if (b.random.chance(0.5))
    factors = b.pick([&](const Value& v) {
      return v.shape.rank() >= 2 && v.shape[0] == shape[0] && v.shape[1] == shape[1] &&
             v.shape.elements() == shape[0] * shape[1];
    });
  else
    factors = b.add("Pooling", {x}, "pooling_param { pool: AVE global_pooling: true }");
  b.add(type, {factors, x, y});
}

/// Inputs are old values and new branches; they differ in one axis at most.
void concat(Builder& b, const char* type) {
  Ids inputs{b.of_rank(1)};
  const Shape shape = b.shape(inputs[0]);
  const int64_t axis = b.random.chance(0.4) ? 0 : random_axis(b, shape);
  const size_t at = shape.canonical_axis(axis, "axis");
  for (int64_t n = b.random.between(0, 3); n > 0; --n)
    inputs.push_back(b.random.chance(0.5) ? b.same_shape(inputs[0]) : b.pick([&](const Value& v) {
      return v.shape.rank() == shape.rank() && v.shape.with(at, 1) == shape.with(at, 1);
    }));
  if (b.random.chance(0.5)) std::reverse(inputs.begin(), inputs.end());
  const size_t whole = b.add(type, inputs, str("concat_param { axis: ", axis, " }"));
  if (b.random.chance(0.4))
    scale_or_bias_by_value(b, b.random.chance(0.5) ? "Scale" : "Bias", whole);
}

void slice(Builder& b, const char* type) {
  const size_t x = b.of_rank(1);
  const Shape shape = b.shape(x);
  const int64_t axis = random_axis(b, shape);
  const int64_t size = shape[shape.canonical_axis(axis, "axis")];
  std::vector<int64_t> points;
  for (int64_t n = b.random.between(1, 2); n > 0 && size > 1; --n)
    points.push_back(b.random.between(1, size - 1));
  std::sort(points.begin(), points.end());
  std::string text = str("axis: ", axis);
  for (const int64_t point : points) text += str(" slice_point: ", point);
  b.add(type, {x}, "slice_param { " + text + " }", points.size() + 1);
}

void split(Builder& b, const char* type) {
  b.add(type, {b.any()}, "", static_cast<size_t>(b.random.between(1, 3)));
}

/// The second input only defines the size of the result: a smaller value, or the output of a
/// pooling.
void crop(Builder& b, const char* type) {
  const size_t x = b.of_rank(4, 4);
  const Shape shape = b.shape(x);
  const size_t like =
      b.random.chance(0.5)
          ? b.add("Pooling", {x}, "pooling_param { pool: AVE kernel_size: 3 stride: 2 }")
          : b.pick([&](const Value& v) {
              return v.shape.rank() == 4 && v.shape[2] <= shape[2] && v.shape[3] <= shape[3];
            });
  b.add(type, {x, like},
        str("crop_param { axis: 2 offset: ", b.random.between(0, 2),
            " offset: ", b.random.between(0, 2), " }"));
}

void crop_center(Builder& b, const char* type) {
  const size_t x = b.of_rank(1);
  std::string sizes;
  for (size_t axis = 0; axis < b.shape(x).rank(); ++axis)
    sizes += str(" crop_size: ", axis < 2 ? 0 : b.random.between(0, 2));
  b.add(type, {x}, "crop_center_param {" + sizes + " }");
}

void flatten(Builder& b, const char* type) {
  const size_t x = b.of_rank(1);
  const int64_t axis = b.random.between(0, signed_rank(b.shape(x)) - 1);
  b.add(type, {x},
        str("flatten_param { axis: ", axis, " end_axis: ",
            b.random.chance(0.6) ? -1 : b.random.between(axis, signed_rank(b.shape(x)) - 1), " }"));
}

void squeeze(Builder& b, const char* type) {
  const size_t x = b.of_rank(2);
  std::string text;
  for (size_t i = 0; i < b.shape(x).rank(); ++i)
    if (b.shape(x)[i] == 1 && b.random.chance(0.7)) text += str(" axis: ", i);
  if (!text.empty()) b.add(type, {x}, "squeeze_param {" + text + " }");
}

void reshape(Builder& b, const char* type) {
  const size_t x = b.of_rank(1);
  const std::vector<int64_t>& axes = b.shape(x).axes();
  const int64_t rank = signed_rank(b.shape(x)), at = b.random.between(0, rank - 1);
  std::vector<int64_t> dims(axes.size(), 0);
  switch (b.random.between(0, 2)) {
    case 0:
      if (at + 1 == rank) throw Unfit();
      dims = {axes.begin(), axes.end()};
      dims[static_cast<size_t>(at)] *= dims[static_cast<size_t>(at) + 1];
      dims.erase(dims.begin() + at + 1);
      break;
    case 1: {
      dims = {axes.begin(), axes.end()};
      std::vector<int64_t> divisors;
      for (int64_t d = 1; d <= dims[static_cast<size_t>(at)]; ++d)
        if (dims[static_cast<size_t>(at)] % d == 0) divisors.push_back(d);
      const int64_t divisor = b.random.of(divisors);
      dims[static_cast<size_t>(at)] /= divisor;
      dims.insert(dims.begin() + at, divisor);
      break;
    }
    default:
      b.add(type, {x}, str("reshape_param { axis: ", at, " num_axes: 0 shape { dim: 1 } }"));
      return;
  }
  dims[static_cast<size_t>(b.random.between(0, static_cast<int64_t>(dims.size()) - 1))] = -1;
  b.add(type, {x}, "reshape_param { " + shape_text(dims) + " }");
}

void permute(Builder& b, const char* type) {
  const size_t x = b.of_rank(1);
  std::vector<size_t> order(b.shape(x).rank());
  for (size_t i = 0; i < order.size(); ++i) order[i] = i;
  for (size_t i = order.size(); i > 1; --i)
    std::swap(order[i - 1],
              order[static_cast<size_t>(b.random.between(0, static_cast<int64_t>(i) - 1))]);
  const bool transposes = std::string(type) == "Transpose";
  std::string text;
  for (const size_t axis : order) text += str(transposes ? " dim: " : " order: ", axis);
  b.add(type, {x}, (transposes ? "transpose_param {" : "permute_param {") + text + " }");
}

void reverse(Builder& b, const char* type) {
  const size_t x = b.of_rank(1);
  std::string axes;
  for (int64_t n = b.random.between(0, 2); n > 0; --n)
    axes += str(" axis: ", random_axis(b, b.shape(x)));
  b.add(type, {x}, "reverse_param {" + axes + " }");
}

void flip(Builder& b, const char* type) {
  b.add(type, {b.of_rank(0, 4)},
        str("flip_param { flip_width: ", flag(b), " flip_height: ", flag(b), " }"));
}

void reorg(Builder& b, const char* type) {
  size_t x = b.of_rank(4, 4);
  const int64_t stride = b.random.between(1, 3);
  if (b.shape(x)[1] % (stride * stride) != 0)
    x = b.add("Convolution", {x},
              str("convolution_param { kernel_size: 1 num_output: ",
                  b.random.between(1, 3) * stride * stride, " }"));
  b.add(type, {x}, str("reorg_param { stride: ", stride, " reverse: ", flag(b), " }"));
}

void depth_to_space(Builder& b, const char* type) {
  const int64_t block = b.random.between(1, 3);
  const size_t x = b.add("Convolution", {b.of_rank(4, 4)},
                         str("convolution_param { kernel_size: 1 num_output: ",
                             b.random.between(1, 3) * block * block, " }"));
  b.add(type, {x},
        str("depth_to_space_param { block_size: ", block, " data_format: '",
            b.random.chance(0.5) ? "NCHW" : "CRD", "' }"));
}

void mul(Builder& b, const char* type) {
  const size_t x = b.of_rank(4, 4);
  const size_t a = b.add("Pooling", {x}, "pooling_param { pool: AVE global_pooling: true }");
  b.add(type, b.random.chance(0.5) ? Ids{x, a} : Ids{a, x});
}

void tile(Builder& b, const char* type) {
  const size_t x = b.of_rank(1);
  b.add(type, {x},
        str("tile_param { axis: ", random_axis(b, b.shape(x)), " tiles: ", b.random.between(1, 3),
            " }"));
}

void shuffle_channel(Builder& b, const char* type) {
  const size_t x = b.of_rank(2);
  b.add(type, {x},
        str("shuffle_channel_param { group: ",
            b.random.between(1, std::min<int64_t>(b.shape(x)[1], 8)), " }"));
}

void batch_reindex(Builder& b, const char* type) {
  const size_t x = b.of_rank(1);
  const size_t indices =
      extra_input(b, {{{b.random.between(1, 4)}}, Fill::kIndices, b.axis_of(x, 0)});
  b.add(type, {x, indices});
}

void filter(Builder& b, const char* type) {
  Ids inputs{b.of_rank(1)};
  const int64_t items = b.shape(inputs[0])[0];
  if (b.random.chance(0.4))
    inputs.push_back(
        b.pick([&](const Value& v) { return v.shape.rank() >= 1 && v.shape[0] == items; }));
  const size_t n = inputs.size();
  inputs.push_back(extra_input(b, {axes_of(b, inputs[0], 0, 1), Fill::kFlags}));
  const size_t rows = b.add(type, inputs, "", n);
  if (b.shape(rows).rank() > 1 && b.random.chance(0.5)) compute_rows(b, rows);
}

void interp(Builder& b, const char* type) {
  static const std::vector<std::string> kSizes{"zoom_factor: 2", "shrink_factor: 2",
                                               "zoom_factor: 2 shrink_factor: 3"};
  const size_t x = b.of_rank(4, 4);
  b.add(type, {x},
        str("interp_param { ",
            b.random.chance(0.5)
                ? b.random.of(kSizes)
                : str("height: ", b.random.between(1, 20), " width: ", b.random.between(1, 20)),
            b.random.chance(0.3) ? " pad_beg: -1 pad_end: 0 }" : " }"));
}

void upsample(Builder& b, const char* type) {
  const bool by_mask = b.random.chance(0.5);
  const size_t x = b.pick([&](const Value& v) {
    return v.shape.rank() == 4 && (!by_mask || (v.exact && v.shape[2] >= 2 && v.shape[3] >= 2));
  });
  if (!by_mask) {
    b.add(type, {x}, str("upsample_param { scale: ", b.random.between(1, 3), " }"));
    return;
  }
  const int64_t h = b.shape(x)[2], w = b.shape(x)[3];
  const size_t pooled =
      b.add("Pooling", {x}, "pooling_param { pool: MAX kernel_size: 2 stride: 2 }", 2);
  b.add(type, {pooled, pooled + 1},
        str("upsample_param { upsample_h: ", h, " upsample_w: ", w, " }"));
}

void dummy_data(Builder& b, const char* type) {
  b.add(type, {},
        str("dummy_data_param { ", shape_text(b.shape(b.any()).axes()),
            " data_filler { type: 'constant' value: ", b.random.real(-1, 1), " } }"));
}

void parameter(Builder& b, const char* type) {
  b.add(type, {}, "parameter_param { " + shape_text(b.shape(b.any()).axes()) + " }");
}

void silence(Builder& b, const char* type) {
  b.add(type, {b.any()}, "", 0);
}

void arg_max(Builder& b, const char* type) {
  const size_t x = b.pick([](const Value& v) { return v.exact && v.shape.rank() >= 1; });
  const int64_t axis = random_axis(b, b.shape(x));
  const bool along = b.random.chance(0.6);
  b.add(type, {x},
        str("argmax_param { top_k: ", b.random.between(1, 3), " out_max_val: ", flag(b),
            along ? str(" axis: ", axis) : "", " }"));
}

Ids labeled_scores(Builder& b, bool exact) {
  const size_t scores =
      b.pick([&](const Value& v) { return v.shape.rank() >= 2 && (v.exact || !exact); });
  std::vector<Size> axes = all_axes(b, scores);
  const Size classes = axes[1];
  axes.erase(axes.begin() + 1);
  return {scores, extra_input(b, {axes, Fill::kIndices, classes})};
}

void accuracy(Builder& b, const char* type) {
  b.add(type, labeled_scores(b, true),
        str("accuracy_param { top_k: ", b.random.between(1, 2), " }"),
        static_cast<size_t>(b.random.between(1, 2)));
}

void softmax_with_loss(Builder& b, const char* type) {
  static const std::vector<std::string> kNormalizations{"FULL", "VALID", "BATCH_SIZE", "NONE"};
  b.add(type, labeled_scores(b, false),
        str("loss_param { normalization: ", b.random.of(kNormalizations),
            b.random.chance(0.3) ? " ignore_label: 0 }" : " }"),
        static_cast<size_t>(b.random.between(1, 2)));
}

void euclidean_loss(Builder& b, const char* type) {
  const size_t x = b.of_rank(1);
  b.add(type, {x, b.same_shape(x)});
}

void prior_box_clustered(Builder& b, const char* type) {
  std::string param = str("clip: ", flag(b), " offset: ", b.random.real(0, 1));
  for (int64_t i = b.random.between(1, 3); i > 0; --i)
    param += str(" width: ", b.random.real(1, 9), " height: ", b.random.real(1, 9));
  b.add(type, {b.of_rank(4, 4), b.of_rank(4, 4)}, "prior_box_param { " + param + " }");
}

size_t prior_boxes(Builder& b, size_t feature, size_t image) {
  return b.add("PriorBox", {feature, image},
               str("prior_box_param { min_size: ", b.random.between(1, 8),
                   b.random.chance(0.5) ? " max_size: 10" : "",
                   b.random.chance(0.5) ? " aspect_ratio: 2" : "", " flip: ", flag(b),
                   " clip: ", flag(b), " offset: 0.5 }"));
}

void prior_box(Builder& b, const char*) {
  const size_t feature = b.of_rank(4, 4);
  prior_boxes(b, feature, b.of_rank(4, 4));
}

/// Reads inputs, because results depend on comparisons.
void detection_output(Builder& b, const char* type) {
  const size_t feature =
      b.pick([](const Value& v) { return v.shape.rank() == 4 && v.shape.product(2, 4) <= 50; });
  const size_t priors = prior_boxes(b, feature, b.of_rank(4, 4));
  const bool shared = b.random.chance(0.5);
  const int64_t classes = 4 * b.random.between(1, 2);  // the prior boxes have 4 numbers each
  Size locations = b.axis_of(priors, 2), confidences = locations;
  locations.factor = shared ? 1 : classes;
  confidences.factor = classes / 4;
  const size_t at = extra_input(b, {{{1, 0}, locations}}),
               sure = extra_input(b, {{{1, 0}, confidences}});
  static const std::vector<std::string> kCodes{"CORNER", "CENTER_SIZE", "CORNER_SIZE"};
  b.add(type, {at, sure, priors},
        str("detection_output_param { num_classes: ", classes, " share_location: ", shared,
            " code_type: ", b.random.of(kCodes), " nms_param { nms_threshold: ",
            b.random.real(0.1, 0.9), b.random.chance(0.5) ? " top_k: 10" : "",
            " } confidence_threshold: ", b.random.real(-1, 0.5),
            b.random.chance(0.5) ? " keep_top_k: 7" : "", " }"));
}

std::string thresholds(Builder& b, const char* score, const char* overlap, double least,
                       double most) {
  return str(score, ": ", b.random.real(least, most), " ", overlap, ": ", b.random.real(0.1, 0.9));
}

/// Reads inputs, because results depend on comparisons.
void yolo(Builder& b, const char* type) {
  const bool v3 = type == std::string("Yolov3DetectionOutput");
  const int64_t boxes = b.random.between(1, 3), classes = b.random.between(1, 3);
  std::string param = str("num_box: ", boxes, " num_classes: ", classes, " ",
                          thresholds(b, "confidence_threshold", "nms_threshold", 0, 0.5));
  for (int64_t i = 0; i < 2 * boxes; ++i) param += str(" biases: ", b.random.real(1, 9));
  Ids maps;
  const int64_t n_maps = b.random.between(1, 2);
  for (int64_t i = 0; i < n_maps; ++i) {
    const int64_t h = b.random.between(1, 4), w = v3 ? b.random.between(1, 4) : h;
    maps.push_back(extra_input(b, {{{1}, {boxes * (5 + classes)}, {h}, {w}}}));
    for (int64_t k = 0; k < boxes && v3; ++k)
      param += str(" mask: ", b.random.between(0, boxes - 1));
    if (v3) param += " anchors_scale: 8";
  }
  if (v3) param += str(" mask_group_num: ", n_maps);
  b.add(type, maps, str(v3 ? "yolov3" : "yolo", "_detection_output_param { ", param, " }"));
}

std::string field_limits(Builder& b) {
  static const std::vector<std::string> kOverlaps{"IOU", "IOMU", "IOFU"};
  return str(thresholds(b, "fg_thr", "iou_thr", -0.5, 0.5), " min_size: ", b.random.between(0, 9),
             " nms_type: '", b.random.of(kOverlaps), "'",
             b.random.chance(0.5) ? " max_nms_num: 9" : "",
             b.random.chance(0.5) ? " max_post_nms_num: 4" : "");
}

std::string offsets_of_boxes(Builder& b) {
  if (b.random.chance(0.5)) return "";
  return str(" bbox_reg_param { bbox_mean: [0, 0.1, 0, -0.1] bbox_std: [0.1, 0.2, ",
             b.random.real(0.1, 1), ", 1] }");
}

void box_output(Builder& b, const char* type) {
  const int64_t images = b.random.between(1, 2), channels = b.random.between(6, 8);
  std::string param = field_limits(b);
  Ids maps;
  for (int64_t i = b.random.between(1, 2); i > 0; --i) {
    maps.push_back(extra_input(
        b, {{{images}, {channels}, {b.random.between(1, 5)}, {b.random.between(1, 5)}}}));
    param += str(" field_w: ", b.random.between(8, 20), " field_h: ", b.random.between(8, 20),
                 " downsample_rate: 8");
  }
  b.add(type, maps, "box_output_param { " + param + " }" + offsets_of_boxes(b),
        static_cast<size_t>(b.random.between(1, 2)));
}

void box_group_output(Builder& b, const char* type) {
  const int64_t images = b.random.between(1, 2);
  std::string param = field_limits(b);
  Ids inputs;
  for (int64_t i = b.random.between(1, 2); i > 0; --i) {
    const int64_t fields = b.random.between(1, 3);
    const Size items{images * fields}, h{b.random.between(1, 5)}, w{b.random.between(1, 5)};
    inputs.push_back(extra_input(b, {{items, {2}, h, w}}));
    inputs.push_back(extra_input(b, {{items, {4}, h, w}}));
    std::string group = "stride: 8";
    for (int64_t k = 0; k < fields; ++k)
      group += str(" field_w: ", b.random.between(8, 20), " field_h: ", b.random.between(8, 20));
    param += " box_group_param { " + group + " }";
  }
  b.add(type, inputs, "box_group_output_param { " + param + " }" + offsets_of_boxes(b),
        static_cast<size_t>(b.random.between(1, 2)));
}

void decode_bbox(Builder& b, const char* type) {
  const int64_t rows = b.random.between(1, 6);
  const size_t offsets = extra_input(b, {{{rows}, {8}}});
  const size_t regions = extra_input(b, {{{rows}, {5}}, Fill::kRegions, {1}});
  b.add(type, {offsets, regions}, offsets_of_boxes(b));
}

}  // namespace

std::string random_windows(Random& random, size_t axes) {
  std::string text;
  const auto each = [&](const std::string& name, const auto& value) {
    const size_t given = random.chance(0.5) ? 1 : axes;
    for (size_t i = 0; i < given; ++i) text += str(" ", name, ": ", value());
  };
  static const std::vector<int64_t> kKernels{1, 1, 2, 3, 3, 3, 3, 4, 5, 5, 7, 9};
  const bool padded = random.chance(0.5), strided = random.chance(0.4);
  if (axes == 0) return "";
  each("kernel_size", [&] { return random.of(kKernels); });
  if (strided) each("stride", [&] { return random.between(1, 4); });
  if (padded && axes == 2 && random.chance(0.2))
    text += pads_of_sides(random, 3);
  else if (padded)
    each("pad", [&] { return random.between(0, 3); });
  if (random.chance(0.15))
    each("dilation", [&] { return random.between(1, 3); });
  else if (random.chance(0.03))
    text += str(" hole: ", random.between(1, 3));
  return text.substr(1);
}

const std::vector<LayerMaker>& layer_makers() {
  static const std::vector<LayerMaker> kMakers{
      {"AbsVal", 2, elementwise},
      {"Accuracy", 1, accuracy},
      {"ArgMax", 2, arg_max},
      {"Axpy", 4, axpy},
      {"BatchNorm", 8, batch_norm},
      {"BatchReindex", 1, batch_reindex},
      {"Bias", 8, scale_or_bias},
      {"BN", 4, bn},
      {"BNLL", 1, elementwise},
      {"BoxGroupOutput", 1, box_group_output},
      {"BoxOutput", 1, box_output},
      {"Clip", 2, clip},
      {"Concat", 16, concat},
      {"ContinuationIndicator", 1, continuation_indicator},
      {"Convolution", 30, convolution},
      {"ConvolutionDepthwise", 2, convolution_depthwise},
      {"Crop", 2, crop},
      {"CropCenter", 1, crop_center},
      {"CTCGreedyDecoder", 1, ctc_greedy_decoder},
      {"DecodeBBox", 1, decode_bbox},
      {"Deconvolution", 3, convolution},
      {"DepthToSpace", 1, depth_to_space},
      {"DepthwiseConvolution", 3, depthwise_convolution},
      {"DetectionOutput", 2, detection_output},
      {"Dropout", 2, dropout},
      {"DummyData", 1, dummy_data},
      {"Eltwise", 14, eltwise},
      {"ELU", 3, elu},
      {"Embed", 1, embed},
      {"EuclideanLoss", 1, euclidean_loss},
      {"Exp", 1, exp},
      {"Filter", 1, filter},
      {"Flatten", 3, flatten},
      {"Flip", 1, flip},
      {"FrcnnProposal", 1, frcnn_proposal},
      {"HardSwish", 1, elementwise},
      {"Im2col", 1, im2col},
      {"InnerProduct", 3, inner_product},
      {"Interp", 2, interp},
      {"Log", 1, log},
      {"LRN", 5, lrn},
      {"LSTM", 1, recurrent},
      {"Lstm", 1, rows_lstm},
      {"Mish", 2, elementwise},
      {"Mul", 1, mul},
      {"MVN", 2, mvn},
      {"Normalize", 2, normalize},
      {"Parameter", 1, parameter},
      {"Permute", 3, permute},
      {"Pooling", 14, pooling},
      {"Power", 4, power},
      {"PReLU", 4, prelu},
      {"PriorBox", 1, prior_box},
      {"PriorBoxClustered", 1, prior_box_clustered},
      {"Proposal", 2, proposal},
      {"PSROIContextPooling", 1, psroi_pooling},
      {"PSROIPooling", 1, psroi_pooling},
      {"Reduction", 2, reduction},
      {"ReLU", 14, relu},
      {"ReLU6", 3, relu6},
      {"Reorg", 1, reorg},
      {"Reshape", 4, reshape},
      {"Reverse", 2, reverse},
      {"RNN", 1, recurrent},
      {"ROIAlign", 1, roi_pooling},
      {"ROIPooling", 1, roi_pooling},
      {"Scale", 10, scale_or_bias},
      {"ShuffleChannel", 2, shuffle_channel},
      {"Sigmoid", 2, elementwise},
      {"Silence", 1, silence},
      {"Slice", 6, slice},
      {"Softmax", 2, softmax},
      {"SoftmaxWithLoss", 1, softmax_with_loss},
      {"Split", 4, split},
      {"SPP", 1, spp},
      {"Squeeze", 2, squeeze},
      {"Swish", 2, swish},
      {"TanH", 2, elementwise},
      {"Threshold", 1, threshold},
      {"Tile", 2, tile},
      {"Transpose", 1, permute},
      {"Upsample", 2, upsample},
      {"YoloDetectionOutput", 1, yolo},
      {"Yolov3DetectionOutput", 1, yolo},
  };
  return kMakers;
}

}  // namespace revisit::random_nets
