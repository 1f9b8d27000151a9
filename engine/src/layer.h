#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "caffe_schema.pb.h"
#include "form.h"
#include "layout.h"
#include "revisit/engine/tensor.h"

namespace revisit::engine {

class WeightCache;
struct BlockedConvolutionKernel;

struct Tensor {
  Shape shape;
  std::vector<float> values;
};

struct PackedWeights {
  AlignedFloats weights, bias;
  AlignedFloats outside_taps = {};  // BlockedConvolutionArguments::outside_taps
  int64_t bytes() const { return floats(weights.size() + bias.size() + outside_taps.size()).count; }
};

struct Call {
  const std::vector<const float*>& inputs;
  const std::vector<float*>& outputs;
  float* scratch;
  float* state = nullptr;
  int64_t* rows = nullptr;  // output: number of rows that a layer with Layer::dynamic_axis() wrote
  const PackedWeights* weights = nullptr;
};

struct Work {
  int64_t macs = 0;
  int64_t multiplications = 0;  // LayerCost::multiplications; 0: same as macs
  Precision products = Precision::kFloat32;
  bool uses_blas = false;
};

/// Possible sharing of memory between outputs and inputs of a kernel that only copies.
enum class Aliasing {
  kNone,
  /// The output is the concatenation of the inputs. Nothing runs if they are already stored so.
  kJoinsInputs,
  /// The outputs are consecutive parts of the input. Outputs that are not stored there are copied.
  kCutsInput,
};

/// A layer bound to shapes and weights, ready to run. Never allocates or fails.
struct Kernel {
  std::string name;
  std::function<void(const Call&)> run;
  Bytes scratch = {};
  Work work = {};
  /// Memory that is zeroed initially and persists across forward passes (LSTM).
  Bytes state = {};
  /// Layouts in which the kernel reads its inputs; empty: all NCHW. The planner adds reorders.
  std::vector<Layout> reads = {};
  Layout writes = Layout::kNchw;
  Aliasing aliasing = Aliasing::kNone;
  Bytes packed = {};  // weights in its own order, in addition to those of the net
  /// Packs the weights or returns a shared copy; null for kernels without packed weights. Must be
  /// called once, after the memory limit is checked.
  std::function<std::shared_ptr<const PackedWeights>()> hold = {};
};

struct Binding {
  const std::vector<Shape>& inputs;
  const std::vector<Shape>& outputs;
  /// Owned by the net. Values are empty if the net was loaded without weights.
  const std::vector<Tensor>& weights;
  int threads = 1;
  bool reference_kernels = false;
  Precision precision = Precision::kFloat32;  // NCHWc values
  bool bf16_weights = false;                  // inner products only
  uint64_t seed = 0;
  /// Available layouts of the inputs, for bind_operation() only; empty for reference kernels.
  std::vector<Layout> layouts = {};
  Fusion fusion = {};            // used by convolutions; bind_operation() handles other layers
  WeightCache* cache = nullptr;  // set if `convolution` is set or operations are fused
  size_t layer = 0;              // key of the layer in the cache
  const BlockedConvolutionKernel* convolution = nullptr;
};

enum class OutputMemory {
  kOwn,
  /// Output 0 may use the memory of input 0: the kernel writes element i of the output after its
  /// last read of element i of input 0. It may read a full channel before writing it. Input 0 may
  /// also be another input; all other inputs are in separate memory.
  kMayReuseInput,
  kViewOfInput,  // same values with another shape or name: nothing runs
};

/// Effect of a layer on relative rounding errors of its inputs.
enum class Rounding {
  kNone,      // unchanged: values are only moved or selected
  kPassed,    // about equal
  kAveraged,  // sums over entire maps, where errors of single values cancel out
  /// Much larger: subtracts means and divides by deviations, which may be relatively small.
  kAmplified,
  /// Much larger, unless an earlier layer averages: only differences of large values matter.
  kCompared,
};

/// Input pixels of output pixel i along one axis: `extent` pixels from i * stride - pad.
struct Window {
  int64_t extent = 1, stride = 1, pad = 0;
};
/// Windows along the last two axes.
struct WindowHw {
  Window h, w;
};
/// Layer::window() of a layer along `axis`: nullopt if the axis is rows or columns, else one pixel.
inline std::optional<WindowHw> window_across(size_t axis, const Shape& input) {
  return axis + 2 < input.rank() ? std::optional(WindowHw{}) : std::nullopt;
}

/// Owns no memory or weights. Functions throw InputError with a reason only; the caller adds file,
/// layer name and type.
class Layer {
 public:
  virtual ~Layer() = default;

  /// Checks all parameters against the input shapes.
  virtual std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const = 0;

  virtual std::vector<Shape> weight_shapes(const std::vector<Shape>&) const { return {}; }

  virtual OutputMemory output_memory() const { return OutputMemory::kOwn; }

  virtual Form form(const std::vector<Shape>&, const std::vector<Tensor>&) const { return {}; }

  /// The only axis along which a value depends on others; nullopt if there is none, or several.
  virtual std::optional<size_t> only_axis(const Shape&) const { return std::nullopt; }

  /// Window of each output pixel; nullopt if it can depend on the entire input.
  virtual std::optional<WindowHw> window(const Shape& input) const {
    if (const auto axis = only_axis(input)) return window_across(*axis, input);
    return output_memory() == OutputMemory::kMayReuseInput ? std::optional(WindowHw{})
                                                           : std::nullopt;
  }

  virtual Rounding rounding() const {
    return output_memory() == OutputMemory::kViewOfInput ? Rounding::kNone : Rounding::kPassed;
  }

  /// Axis of every output whose size depends on the data, if any. infer() returns the maximum size;
  /// the kernel writes at most that many rows, contiguously, and stores their number in Call::rows.
  /// All earlier axes have size 1.
  virtual std::optional<size_t> dynamic_axis() const { return std::nullopt; }

  /// Returns whether item i (axis 0) of every output depends on item i only of input `port`.
  virtual bool keeps_items(size_t /*port*/, const std::vector<Shape>& inputs) const {
    return !inputs.empty() && only_axis(inputs[0]) > 0U;
  }

  /// Returns whether the file may use the input's name for an output. For other layers Caffe
  /// rejects it or reads overwritten values, so there is no correct result.
  virtual bool allows_in_place() const { return output_memory() != OutputMemory::kOwn; }

  /// Binds the NCHW kernel for shapes that infer() accepted. Not called for views.
  virtual Kernel bind(const Binding& binding) const = 0;
};

/// Returns whether the layer itself has `phase: TRAIN`, so that Caffe runs it in training mode.
bool is_for_training(const caffe::LayerParameter& param);

class OneToOneLayer : public Layer {
 public:
  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const final;

 protected:
  /// Implements infer() after the numbers of inputs and outputs are checked.
  virtual Shape output_shape(const Shape& input) const { return input; }
};

/// Throws InputError unless `found` equals `expected`; `what` is "inputs" or "outputs".
void expect_count(size_t found, size_t expected, const char* what);
/// Throws InputError unless `found` is 1 or 2.
void expect_1_or_2(size_t found, const char* what);
/// Throws InputError unless `found` is positive.
void expect_any(size_t found, const char* what);

/// Throws InputError with `what` unless the input is an image: n x c x h x w.
void expect_image(const Shape& input, const char* what);
void expect_channels(const Shape& input, const char* what);

/// Throws InputError unless a size fits an int, as in Caffe. Products of two then fit an int64_t.
void expect_int(int64_t size, const char* what);

}  // namespace revisit::engine
