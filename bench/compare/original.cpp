// Algorithms of the original Caffe on a CPU: every layer processes full values; convolution applies
// im2col to a full image, then BLAS (Jia et al. 2014).
#include <cblas.h>

#include <cfloat>
#include <cmath>
#include <functional>

#include "kernels/convolution.h"
#include "layers/convolution.h"
#include "layers/pooling_window.h"
#include "subject.h"

namespace revisit::bench {
namespace {

using engine::ConvolutionProblem;
using engine::PoolingProblem;
using engine::Shape;
using Values = std::vector<float>;

int blas_size(int64_t n) {
  return static_cast<int>(n);
}

void gemm(bool transpose_b, int64_t m, int64_t n, int64_t k, const float* a, const float* b,
          float beta, float* c) {
  cblas_sgemm(CblasRowMajor, CblasNoTrans, transpose_b ? CblasTrans : CblasNoTrans, blas_size(m),
              blas_size(n), blas_size(k), 1, a, blas_size(k), b, blas_size(transpose_b ? k : n),
              beta, c, blas_size(n));
}

ConvolutionProblem convolution_problem(const ModelLayer& layer, const Shape& in, const Shape& out) {
  const auto& param = layer.param.convolution_param();
  const engine::WindowAxes axes = engine::window_axes(param, 2);
  ConvolutionProblem p;
  p.n = in[0], p.c_in = in[1], p.h = in[2], p.w = in[3];
  p.c_out = out[1], p.out_h = out[2], p.out_w = out[3];
  p.kernel_h = axes[0].kernel, p.kernel_w = axes[1].kernel;
  p.stride_h = axes[0].stride, p.stride_w = axes[1].stride;
  p.pad_h = axes[0].pad, p.pad_w = axes[1].pad;
  p.dilation_h = axes[0].dilation, p.dilation_w = axes[1].dilation;
  p.group = param.group();
  return p;
}

void im2col(const ConvolutionProblem& p, const float* image, float* columns) {
  for (int64_t c = 0; c < p.c_in; ++c, image += p.h * p.w)
    for (int64_t ky = 0; ky < p.kernel_h; ++ky)
      for (int64_t kx = 0; kx < p.kernel_w; ++kx)
        for (int64_t y = 0; y < p.out_h; ++y, columns += p.out_w) {
          const int64_t iy = y * p.stride_h - p.pad_h + ky * p.dilation_h;
          if (iy < 0 || iy >= p.h) {
            std::fill_n(columns, p.out_w, 0.0F);
            continue;
          }
          int64_t ix = kx * p.dilation_w - p.pad_w;
          for (int64_t x = 0; x < p.out_w; ++x, ix += p.stride_w)
            columns[x] = ix >= 0 && ix < p.w ? image[iy * p.w + ix] : 0;
        }
}

using Step = std::function<void()>;

Step convolution(const ModelLayer& layer, const ConvolutionProblem& p, const Values& in,
                 Values& out) {
  const bool pointwise = p.kernel_h == 1 && p.kernel_w == 1 && p.stride_h == 1 && p.stride_w == 1 &&
                         p.pad_h == 0 && p.pad_w == 0;
  const bool has_bias = layer.weights.size() > 1;
  Values ones(static_cast<size_t>(p.out_pixels()), 1);
  Values unfolded(pointwise ? 0 : static_cast<size_t>(p.group * p.depth() * p.out_pixels()));
  return [=, &layer, &in, &out, columns = std::move(unfolded), ones = std::move(ones)]() mutable {
    const int64_t pixels = p.out_pixels(), c_out = p.c_out_per_group();
    for (int64_t n = 0; n < p.n; ++n) {
      const float* image = in.data() + n * p.c_in * p.h * p.w;
      float* result = out.data() + n * p.c_out * pixels;
      if (!pointwise) im2col(p, image, columns.data());
      const float* b = pointwise ? image : columns.data();
      for (int64_t g = 0; g < p.group; ++g)
        gemm(false, c_out, pixels, p.depth(), layer.weights[0].data() + g * c_out * p.depth(),
             b + g * p.depth() * pixels, 0, result + g * c_out * pixels);
      if (has_bias)
        gemm(false, p.c_out, pixels, 1, layer.weights[1].data(), ones.data(), 1, result);
    }
  };
}

Step relu(float slope, const Values& in, Values& out) {
  return [=, &in, &out] {
    for (size_t i = 0; i < in.size(); ++i)
      out[i] = std::max(in[i], 0.0F) + slope * std::min(in[i], 0.0F);
  };
}

/// Computes a running sum over channels of zero-padded squares, then a power per element.
Step lrn(const caffe::LRNParameter& param, const Shape& shape, const Values& in, Values& out) {
  const int64_t c = shape[1], pixels = shape[2] * shape[3], size = param.local_size();
  const float alpha = param.alpha() / static_cast<float>(size);
  const float beta = param.beta(), k = param.k();
  Values squares(static_cast<size_t>((c + size - 1) * pixels), 0), sums(in.size());
  return [=, &in, &out, padded = std::move(squares), scale = std::move(sums)]() mutable {
    std::fill(scale.begin(), scale.end(), k);
    const int n = blas_size(pixels);
    for (int64_t image = 0; image < shape[0]; ++image) {
      const float* from = in.data() + image * c * pixels;
      float* const to = scale.data() + image * c * pixels;
      float* const middle = padded.data() + (size - 1) / 2 * pixels;
      for (int64_t i = 0; i < c * pixels; ++i) middle[i] = from[i] * from[i];
      for (int64_t j = 0; j < size; ++j) cblas_saxpy(n, alpha, &padded[j * pixels], 1, to, 1);
      for (int64_t j = 1; j < c; ++j) {
        std::copy_n(to + (j - 1) * pixels, pixels, to + j * pixels);
        cblas_saxpy(n, alpha, &padded[(j + size - 1) * pixels], 1, to + j * pixels, 1);
        cblas_saxpy(n, -alpha, &padded[(j - 1) * pixels], 1, to + j * pixels, 1);
      }
    }
    for (size_t i = 0; i < in.size(); ++i) out[i] = std::pow(scale[i], -beta);
    for (size_t i = 0; i < in.size(); ++i) out[i] *= in[i];
  };
}

void max_pool(const PoolingProblem& p, const float* in, float* out, int* where) {
  std::fill_n(out, p.planes * p.out_h * p.out_w, -FLT_MAX);
  std::fill_n(where, p.planes * p.out_h * p.out_w, -1);
  for (int64_t plane = 0; plane < p.planes; ++plane, in += p.h * p.w)
    for (int64_t y = 0; y < p.out_h; ++y)
      for (int64_t x = 0; x < p.out_w; ++x, ++out, ++where) {
        const int64_t top = y * p.stride_h - p.pad_h, left = x * p.stride_w - p.pad_w;
        const int64_t bottom = std::min(top + p.kernel_h, p.h);
        const int64_t right = std::min(left + p.kernel_w, p.w);
        for (int64_t iy = std::max<int64_t>(top, 0); iy < bottom; ++iy)
          for (int64_t ix = std::max<int64_t>(left, 0); ix < right; ++ix)
            if (in[iy * p.w + ix] > *out) {
              *out = in[iy * p.w + ix];
              *where = static_cast<int>(iy * p.w + ix);
            }
      }
}

Step pooling(const ModelLayer& layer, const Shape& shape, const Values& in, Values& out) {
  const engine::PoolingWindow window(layer.param.pooling_param());
  const PoolingProblem p = window.problem(shape);
  if (!window.is_max()) return [=, &in, &out] { engine::average_pool(p, in.data(), out.data()); };
  return [=, &in, &out, where = std::vector<int>(out.size())]() mutable {
    max_pool(p, in.data(), out.data(), where.data());
  };
}

/// Expands mean and deviation to the image size, then applies each in its own pass.
Step batch_norm(const ModelLayer& layer, const Shape& shape, const Values& in, Values& out) {
  const float factor = layer.weights[2][0] == 0 ? 0 : 1 / layer.weights[2][0];
  const float eps = layer.param.batch_norm_param().eps();
  const int64_t c = shape[1], pixels = shape.product(2, shape.rank());
  Values spread(in.size()), normalized(in.size());
  return [=, &layer, &in, &out, wide = std::move(spread), kept = std::move(normalized)]() mutable {
    if (&in != &out) out = in;
    for (int64_t plane = 0; plane < shape[0] * c; ++plane)
      for (int64_t i = plane * pixels; i < (plane + 1) * pixels; ++i)
        out[i] -= factor * layer.weights[0][plane % c];
    for (int64_t plane = 0; plane < shape[0] * c; ++plane) {
      const float deviation = std::sqrt(factor * layer.weights[1][plane % c] + eps);
      std::fill_n(wide.begin() + plane * pixels, pixels, deviation);
    }
    for (size_t i = 0; i < out.size(); ++i) out[i] /= wide[i];
    kept = out;
  };
}

Step scale(const ModelLayer& layer, const Shape& shape, const Values& in, Values& out) {
  const int64_t c = shape[1], pixels = shape.product(2, shape.rank());
  return [=, &layer, &in, &out] {
    for (int64_t plane = 0; plane < shape[0] * c; ++plane)
      for (int64_t i = plane * pixels; i < (plane + 1) * pixels; ++i)
        out[i] = in[i] * layer.weights[0][plane % c];
    if (layer.weights.size() < 2) return;
    for (int64_t plane = 0; plane < shape[0] * c; ++plane)
      for (int64_t i = plane * pixels; i < (plane + 1) * pixels; ++i)
        out[i] += layer.weights[1][plane % c];
  };
}

Step inner_product(const ModelLayer& layer, int64_t m, const Values& in, Values& out) {
  const int64_t n = layer.param.inner_product_param().num_output();
  const int64_t k = static_cast<int64_t>(in.size()) / m;
  return [=, &layer, &in, &out, ones = Values(static_cast<size_t>(m), 1)] {
    gemm(true, m, n, k, in.data(), layer.weights[0].data(), 0, out.data());
    if (layer.weights.size() > 1)
      gemm(false, m, n, 1, ones.data(), layer.weights[1].data(), 1, out.data());
  };
}

Step softmax(const Shape& shape, const Values& in, Values& out) {
  const int64_t c = shape[1], pixels = shape.product(2, shape.rank());
  return [=, &in, &out] {
    for (int64_t i = 0; i < shape[0] * pixels; ++i) {
      const int64_t first = i / pixels * c * pixels + i % pixels;
      float largest = -FLT_MAX, sum = 0;
      for (int64_t k = 0; k < c; ++k) largest = std::max(largest, in[first + k * pixels]);
      for (int64_t k = 0; k < c; ++k)
        sum += out[first + k * pixels] = std::exp(in[first + k * pixels] - largest);
      for (int64_t k = 0; k < c; ++k) out[first + k * pixels] /= sum;
    }
  };
}

class Original : public Subject {
 public:
  Original(const Model& model, const Setting& setting, std::span<const float> input)
      : model_(model), threads_(setting.threads), memory_(model.values.size()) {
    memory_[0] = std::make_shared<Values>(input.begin(), input.end());
    for (const ModelLayer& layer : model_.layers) {
      add(layer);
    }
  }

  std::string name() const override { return "im2col + OpenBLAS"; }

  void forward() override {
    openblas_set_num_threads(threads_);
    for (const Step& step : steps_) step();
    openblas_set_num_threads(1);  // because other engines expect it
  }

  std::vector<double> timed_forward() override {
    openblas_set_num_threads(threads_);
    std::vector<double> times;
    for (const auto& step : steps_) {
      const double start = now_ms();
      step();
      times.push_back(now_ms() - start);
    }
    openblas_set_num_threads(1);
    return times;
  }

  std::span<const float> output() const override { return *memory_[model_.output()]; }

 private:
  void add(const ModelLayer& layer) {
    const Shape& shape = model_.values[layer.inputs[0]];
    for (const size_t value : layer.outputs)
      memory_[value] = layer.in_place() ? memory_[layer.inputs[0]]
                                        : std::make_shared<Values>(model_.values[value].elements());
    const Values& in = *memory_[layer.inputs[0]];
    Values& out = *memory_[layer.outputs[0]];
    const std::string& type = layer.param.type();
    if (type == "Convolution")
      steps_.push_back(convolution(
          layer, convolution_problem(layer, shape, model_.values[layer.outputs[0]]), in, out));
    else if (type == "ReLU")
      steps_.push_back(relu(layer.param.relu_param().negative_slope(), in, out));
    else if (type == "LRN")
      steps_.push_back(lrn(layer.param.lrn_param(), shape, in, out));
    else if (type == "Pooling")
      steps_.push_back(pooling(layer, shape, in, out));
    else if (type == "BatchNorm")
      steps_.push_back(batch_norm(layer, shape, in, out));
    else if (type == "Scale")
      steps_.push_back(scale(layer, shape, in, out));
    else if (type == "InnerProduct")
      steps_.push_back(inner_product(layer, shape[0], in, out));
    else if (type == "Softmax")
      steps_.push_back(softmax(shape, in, out));
    else if (type == "Eltwise")
      add_sum(layer, out);
    else if (type == "Concat")
      add_concat(layer, out);
    else if (type == "Dropout")
      memory_[layer.outputs[0]] = memory_[layer.inputs[0]];
    else
      throw UnsupportedError(str("im2col + OpenBLAS: no layer type ", type));
  }

  void add_sum(const ModelLayer& layer, Values& out) {
    if (layer.param.eltwise_param().operation() != caffe::EltwiseParameter::SUM ||
        layer.param.eltwise_param().coeff_size() > 0)
      throw UnsupportedError("im2col + OpenBLAS: of Eltwise only the plain sum");
    for (size_t i = 0; i < layer.inputs.size(); ++i) {
      steps_.push_back([&in = *memory_[layer.inputs[i]], &out, first = i == 0] {
        if (first) std::fill(out.begin(), out.end(), 0.0F);
        cblas_saxpy(blas_size(static_cast<int64_t>(in.size())), 1, in.data(), 1, out.data(), 1);
      });
    }
  }

  void add_concat(const ModelLayer& layer, Values& out) {
    const Shape& whole = model_.values[layer.outputs[0]];
    int64_t offset = 0;
    for (const size_t value : layer.inputs) {
      const Shape& part = model_.values[value];
      const int64_t floats = part.product(1, part.rank()), pitch = whole.product(1, whole.rank());
      steps_.push_back([&in = *memory_[value], &out, floats, pitch, offset, n = part[0]] {
        for (int64_t i = 0; i < n; ++i)
          std::copy_n(in.data() + i * floats, floats, out.data() + i * pitch + offset);
      });
      offset += floats;
    }
  }

  const Model& model_;
  int threads_;
  std::vector<std::shared_ptr<Values>> memory_;  // by value; in-place layers share
  std::vector<Step> steps_;
};

}  // namespace

std::unique_ptr<Subject> make_original(const Model& model, const Setting& setting,
                                       std::span<const float> input) {
  return std::make_unique<Original>(model, setting, input);
}

}  // namespace revisit::bench
