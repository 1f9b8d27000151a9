#include "layers/layers.h"

namespace revisit::engine {
namespace {

class Flatten : public OneToOneLayer {
 public:
  explicit Flatten(const caffe::FlattenParameter& param) : param_(param) {}

  Shape output_shape(const Shape& input) const override {
    const size_t first = input.canonical_axis(param_.axis(), "flatten axis");
    const size_t last = input.canonical_axis(param_.end_axis(), "flatten end_axis");
    if (last < first) throw InputError("end_axis ", last, " comes before axis ", first);
    std::vector<int64_t> axes(input.axes().begin(),
                              input.axes().begin() + static_cast<int64_t>(first));
    axes.push_back(input.product(first, last + 1));
    axes.insert(axes.end(), input.axes().begin() + static_cast<int64_t>(last) + 1,
                input.axes().end());
    return Shape(std::move(axes));
  }
  OutputMemory output_memory() const override { return OutputMemory::kViewOfInput; }
  bool allows_in_place() const override { return false; }
  Kernel bind(const Binding&) const override { return {}; }

 private:
  caffe::FlattenParameter param_;
};

}  // namespace

std::unique_ptr<Layer> make_flatten(const caffe::LayerParameter& param) {
  return std::make_unique<Flatten>(param.flatten_param());
}

}  // namespace revisit::engine
