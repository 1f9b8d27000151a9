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

/// The weights of a layer as its kernel reads them, and what keeps them in memory.
struct HeldWeights {
  const float* weights = nullptr;
  const float* bias = nullptr;
  const float* outside_taps = nullptr;  // BlockedConvolutionArguments::outside_taps
  std::shared_ptr<const void> owner;
};

/// The pointers of one execution of one kernel; shapes were fixed when it was bound.
struct Call {
  const std::vector<const float*>& inputs;
  const std::vector<float*>& outputs;
  float* scratch;
  float* state = nullptr;   // see Kernel::state
  int64_t* rows = nullptr;  // where a layer with Layer::dynamic_axis() says how many it wrote
  const HeldWeights* weights = nullptr;  // what Kernel::hold gave
};

/// Products of a kernel, and how it computes them.
struct Work {
  int64_t macs = 0;
  int64_t multiplications = 0;  // LayerCost::multiplications; 0: as many as macs
  Precision products = Precision::kFloat32;
  bool uses_blas = false;  // OpenBLAS multiplies
  bool winograd = false;
};

/// How outputs of a kernel that only copies may lie in the memory of its inputs.
enum class Aliasing {
  kNone,
  /// The output is the inputs one after another: where they already lie so, nothing has to run.
  kJoinsInputs,
  /// The outputs are the input, one after another: they may be parts of it; the others are copied.
  kCutsInput,
};

/// A layer bound to shapes and weights, ready to run. Never allocates, never fails.
struct Kernel {
  std::string name;  // for people
  std::function<void(const Call&)> run;
  Bytes scratch = {};
  Work work = {};
  /// Memory that starts as zeros and stays from one forward pass to the next (LSTM).
  Bytes state = {};
  /// The layout it wants each input in; empty: all plain. The planner reorders where needed.
  std::vector<Layout> reads = {};
  Layout writes = Layout::kNchw;
  Aliasing aliasing = Aliasing::kNone;
  Bytes packed = {};  // weights in its own order, beside those of the net
  /// Makes the packed weights, or takes those that are there; null for kernels without. To be
  /// called once, when it is known that there is memory for them.
  std::function<HeldWeights()> hold = {};
};

/// All that a layer may know when it is bound.
struct Binding {
  const std::vector<Shape>& inputs;
  const std::vector<Shape>& outputs;
  /// Kept alive by the plan. Values are empty when the net is only inspected.
  const std::vector<Tensor>& weights;
  int threads = 1;
  bool reference_kernels = false;
  Precision precision = Precision::kFloat32;  // of blocked values
  bool bf16_weights = false;                  // of inner products
  uint64_t seed = 0;                          // of random numbers
  /// The layouts that the inputs are in, empty for reference kernels: for bind_operation() only.
  std::vector<Layout> layouts = {};
  Fusion fusion = {};            // only convolutions look at it, bind_operation() does the rest
  WeightCache* cache = nullptr;  // there when `convolution` is or something is fused
  size_t layer = 0;              // that the cache knows it as
  /// Of a convolution: choose_convolution().
  const BlockedConvolutionKernel* convolution = nullptr;
};

/// Where the outputs live.
enum class OutputMemory {
  kOwn,  // separate from the inputs
  /// Output 0 may lie exactly where input 0 lies: the kernel writes element i of the output when
  /// nothing reads element i of input 0 any more. Reading all of a channel before writing it is
  /// fine. Input 0 may be given again as another input; all other inputs lie elsewhere.
  kMayReuseInput,
  kViewOfInput,  // the same values under another shape or name: nothing runs
};

/// What a layer does to the rounding errors of its inputs, relative to the values.
enum class Rounding {
  kNone,      // as large: values are only moved or chosen
  kPassed,    // about as large
  kAveraged,  // sums over whole maps, where errors of single values cancel out
  /// Far larger: means are subtracted and divided by deviations, which may be small against them.
  kAmplified,
  /// Far larger, as only differences of large values count: seen where nothing averaged before.
  kCompared,
};

/// The pixels that an output pixel i depends on, along one axis: `extent` from i * stride - pad on.
struct Window {
  int64_t extent = 1, stride = 1, pad = 0;
};
/// Of the last two axes.
struct WindowHw {
  Window h, w;
};
/// Layer::window() of a layer that works along `axis`: nothing for rows and columns, else a pixel.
std::optional<WindowHw> window_across(size_t axis, const Shape& input);

/// One layer type with its parameters. Knows shapes and picks kernels; owns no memory and no
/// weights. Created from the file's description by the registry. Functions throw InputError with a
/// reason only: the caller adds file, layer name and type.
class Layer {
 public:
  virtual ~Layer() = default;

  /// Shapes of `n_outputs` outputs for these inputs, with every check of parameters against shapes.
  virtual std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const = 0;

  /// Shapes of the weight blobs, in the file's order.
  virtual std::vector<Shape> weight_shapes(const std::vector<Shape>&) const { return {}; }

  virtual OutputMemory output_memory() const { return OutputMemory::kOwn; }

  /// The computation, where the planner can merge it with its neighbours.
  virtual Form form(const std::vector<Shape>&, const std::vector<Tensor>&) const { return {}; }

  /// The window of each output pixel; nothing when it can see the whole input.
  virtual std::optional<WindowHw> window(const Shape&) const {
    return output_memory() == OutputMemory::kMayReuseInput ? std::optional(WindowHw{})
                                                           : std::nullopt;
  }

  virtual Rounding rounding() const {
    return output_memory() == OutputMemory::kViewOfInput ? Rounding::kNone : Rounding::kPassed;
  }

  /// The axis of every output whose size depends on the data, if there is one: infer() gives its
  /// maximum, the kernel writes that many rows or fewer, without gaps, and stores the number in
  /// Call::rows. All axes before it have size 1.
  virtual std::optional<size_t> dynamic_axis() const { return std::nullopt; }

  /// Whether item i (axis 0) of every output depends, of input `port`, on its item i alone: then
  /// items may be fewer than the plan has, and the rest is cut off.
  virtual bool keeps_items(size_t /*port*/, const std::vector<Shape>& /*inputs*/) const {
    return false;
  }

  /// Whether the file may give an output the name of its input. That would be harmless here; but if
  /// the original refuses it or reads what it has overwritten, no result is the right one.
  virtual bool allows_in_place() const { return output_memory() != OutputMemory::kOwn; }

  /// The kernel on plain values for shapes that infer() accepted. Not called for views.
  virtual Kernel bind(const Binding& binding) const = 0;
};

/// Whether the file says `phase: TRAIN` on the layer itself, which Caffe then runs as in training.
bool is_for_training(const caffe::LayerParameter& param);

/// A layer with one input and one output.
class OneToOneLayer : public Layer {
 public:
  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const final;

 protected:
  /// Layer::infer() once the numbers of inputs and outputs are right.
  virtual Shape output_shape(const Shape& input) const { return input; }
};

/// Throws InputError unless there are `expected` of `what` ("inputs", "outputs").
void expect_count(size_t found, size_t expected, const char* what);

/// Throws InputError, naming `what`, unless the input is an image: n x c x h x w.
void expect_image(const Shape& input, const char* what);
/// Throws InputError, naming `what`, unless the input has channels.
void expect_channels(const Shape& input, const char* what);

/// Throws InputError unless a size fits an int, as in Caffe: products of two then fit an int64_t.
void expect_int(int64_t size, const char* what);

}  // namespace revisit::engine
