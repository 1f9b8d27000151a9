#include "layers/convolution_window.h"
#include "layers/layers.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::engine {
namespace {

/// Windows of a convolution as channels: channel c and kernel element k yield channel c * K + k.
class Im2col : public OneToOneLayer {
 public:
  explicit Im2col(const caffe::ConvolutionParameter& param) : param_(param) {}

  Shape output_shape(const Shape& input) const override {
    const size_t axis = channel_axis(input);
    const WindowAxes windows = windows_of(input);
    int64_t channels = input[axis];
    std::vector<int64_t> axes = input.axes();
    for (size_t i = 0; i < windows.size(); ++i) {
      // Checked at each step, because the product of many kernel sizes can exceed 64 bits.
      channels = Shape{channels, windows[i].kernel}.elements();
      axes[axis + 1 + i] = windows[i].windows;
    }
    axes[axis] = channels;
    return Shape(std::move(axes));
  }

  std::optional<WindowHw> window(const Shape& input) const override {
    return window_of_last_axes(windows_of(input));
  }

  Kernel bind(const Binding& binding) const override {
    const size_t axis = channel_axis(binding.inputs[0]);
    const WindowAxes axes = windows_of(binding.inputs[0]);
    const int64_t planes = binding.inputs[0].product(0, axis + 1);
    return {"im2col", [axes, planes, threads = binding.threads](const Call& call) {
              const int64_t taps = product_of(axes, &WindowAxis::kernel);
              const int64_t pixels = product_of(axes, &WindowAxis::image);
              const int64_t windows = product_of(axes, &WindowAxis::windows);
              parallel_for(planes * taps, threads, [&](int64_t item, int) {
                gather_pixels(axes, call.inputs[0] + item / taps * pixels, item % taps, 0, windows,
                              call.outputs[0] + item * windows);
              });
            }};
  }

 private:
  size_t channel_axis(const Shape& input) const {
    return input.canonical_axis(param_.axis(), "im2col axis");
  }

  WindowAxes windows_of(const Shape& input) const {
    const size_t axis = channel_axis(input);
    WindowAxes axes = window_axes(param_, input.rank() - axis - 1);
    if (axes.empty())
      throw InputError("expected at least one axis after the channels, found ", input);
    for (size_t i = 0; i < axes.size(); ++i) {
      axes[i].image = input[axis + 1 + i];
      axes[i].windows = count_windows(axes[i]);
    }
    return axes;
  }

  caffe::ConvolutionParameter param_;
};

}  // namespace

std::unique_ptr<Layer> make_im2col(const caffe::LayerParameter& param) {
  return std::make_unique<Im2col>(param.convolution_param());
}

}  // namespace revisit::engine
