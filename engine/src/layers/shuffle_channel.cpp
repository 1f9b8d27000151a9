#include "layers/join_and_cut.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// Transposes channels [group][channel of the group] (layer of the ShuffleNet fork).
class ShuffleChannel : public OneToOneLayer {
 public:
  explicit ShuffleChannel(const caffe::ShuffleChannelParameter& param) : groups_(param.group()) {
    if (groups_ < 1) throw InputError("group must be at least 1");
  }

  Shape output_shape(const Shape& input) const override {
    expect_channels(input, "ShuffleChannel");
    if (input[1] % groups_ != 0)
      throw InputError("the ", input[1], " channels of the input (", input,
                       ") are not a multiple of group ", groups_);
    return input;
  }

  bool keeps_items(size_t, const std::vector<Shape>&) const override { return true; }

  std::optional<WindowHw> window(const Shape&) const override { return WindowHw{}; }

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>&) const override {
    Shuffling shuffling;
    for (int64_t c = 0; c < inputs[0][1]; ++c)
      shuffling.sources.push_back(c % groups_ * (inputs[0][1] / groups_) + c / groups_);
    return shuffling;
  }

  Kernel bind(const Binding& binding) const override {
    const Shape& input = binding.inputs[0];
    const int64_t inner = input.product(2, input.rank()), per_group = input[1] / groups_;
    return copy_kernel("transpose", {{input[0], per_group, groups_, inner},
                                     {input[1] * inner, inner, per_group * inner, 1},
                                     0,
                                     binding.threads});
  }

 private:
  int64_t groups_;
};

}  // namespace

std::unique_ptr<Layer> make_shuffle_channel(const caffe::LayerParameter& param) {
  return std::make_unique<ShuffleChannel>(param.shuffle_channel_param());
}

}  // namespace revisit::engine
