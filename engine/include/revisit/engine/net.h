#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "revisit/base/error.h"
#include "revisit/engine/tensor.h"
#include "revisit/proto/limits.h"

namespace revisit::engine {

/// The system refused memory; the message has the amount and the purpose.
class MemoryError : public Error {
  using Error::Error;
};

/// What Net::load() reads, and how.
struct LoadOptions {
  /// Layer that provides the output, before in-place layers that follow; or, if no layer has the
  /// name, a blob after them. Later layers and their weights are not read. Empty: the full net.
  std::string end = {};
  /// Layer without weights (e.g. "pool5") to append after `end`, its in-place layers, and its
  /// BatchNorm, Scale and ReLU: the paper's "conv3+pool5". If other layers read the same value, a
  /// BatchNorm, Scale or ReLU that is not in-place is skipped with a warning.
  std::string graft = {};
  /// Overrides shapes of net inputs in the prototxt, by blob name.
  std::map<std::string, Shape> inputs = {};
  /// Fills weights that the file lacks as Caffe does before training, instead of throwing. Fillers
  /// are zero if the prototxt has none; random ones depend on `fill_seed`.
  bool allow_missing = false;
  uint64_t fill_seed = 0;  ///< seed of random fillers
  /// Downgrades errors for unknown fields outside the parameters of layers to warnings.
  bool allow_unknown = false;
  /// Limits on the files. `limits.weight_bytes` also bounds the weights in memory, before they are
  /// allocated, because a short prototxt can declare any amount.
  proto::Limits limits = {};
};

/// A named input or output of a net.
struct Port {
  std::string name;  ///< blob of an input; name of an output
  Shape shape;       ///< the maximum, if the number of rows depends on the data
};

/// Settings of Net::plan().
struct PlanOptions {
  /// Threads of one forward pass, 1 to 1024. Results do not depend on it, bit for bit.
  int threads = 1;
  /// Keeps the outputs of all layers, not only the net's outputs; disables layer fusion.
  bool keep_all = false;
  /// Layers whose outputs are kept for Run::layer_output(), by proto::port_name(). Disables only
  /// fusions that would overwrite them.
  std::vector<std::string> keep = {};
  /// Disables SIMD, OpenBLAS and layer fusion: the reference that tests compare fast kernels with.
  /// Types without a slow, readable kernel ("reference" in LayerCost::kernel) use their only NCHW
  /// kernel, a plain loop.
  bool reference_kernels = false;
  /// Maximum memory of one run in addition to the file's weights [bytes]: Plan::arena_bytes() plus
  /// Plan::packed_weight_bytes(), including parts shared with other plans. If the fastest kernels
  /// exceed it, all kernels use the weights unpacked. If that exceeds it, too, Net::plan() throws
  /// before allocating.
  int64_t max_run_bytes = int64_t{8} << 30;
  /// Treats denormals (magnitude below 1.2e-38) as zero during a pass; Caffe keeps them. On x86
  /// each costs about a hundred cycles: 13 times the run time for an LSTM with closed gates, 55
  /// times for a net whose values have faded out. The difference is below any rounding error, but
  /// the logarithm of such a probability becomes -infinity. The calling thread's mode is restored.
  bool flush_denormals = true;
  /// Limits the tiles of Winograd's algorithm to 4x4 outputs everywhere: about the rounding error
  /// of Caffe's own products. Larger tiles are faster and less accurate. By default they are
  /// limited only before layers that amplify rounding errors: BatchNorm, MVN that divides by the
  /// deviation, and Softmax on maps without averaging before. Nets without such layers are within
  /// 1e-5 of Caffe (maximum error / maximum value of a layer). Errors of real nets:
  /// docs/reference/ACCURACY.md.
  bool strict_accuracy = false;
  /// Ignored by reference_kernels, which compute in float32.
  Precision precision = Precision::kFloat32;
  /// Stores weights of inner products of up to 8 inputs in bfloat16, also with float32. This halves
  /// the time if reading weights dominates. The copies take memory next to the file's weights.
  bool bf16_weights = false;
  /// Random seed of Dropout layers that drop at inference (sample_weights_test). Passes of a run
  /// differ from each other, but every run repeats the same sequence.
  uint64_t seed = 0;
  /// Replicated single-channel input. Precondition: the net has one image input, whose channel c is
  /// x + channel_offsets[c] for one picture x. The run's input is then x, with one channel. This
  /// saves the products of the other channels in the first convolution.
  std::optional<std::vector<float>> channel_offsets = {};
};

/// Receptive field of an output pixel on the net's input along one axis: output pixel i depends on
/// input pixels [start + i * stride, start + i * stride + size). A negative start is padding.
struct ReceptiveField {
  int64_t size = 1, stride = 1, start = 0;  ///< [pixels], see above
  friend bool operator==(const ReceptiveField&, const ReceptiveField&) = default;
};

/// Memory of one output or scratch in the arena of a run.
struct BufferUse {
  std::string what;                     ///< layer that owns the output or scratch
  int64_t offset_bytes = 0, bytes = 0;  ///< position in the arena, and size
  size_t first_layer = 0,
         last_layer = 0;  ///< indices into Plan::layers(); last may be one past the end
};

/// One layer of a plan with its kernel and cost.
struct LayerCost {
  std::string name, type;  ///< as in the file
  /// Display name. "" if the layer is only a view of its input, "in conv1" if it is fused into
  /// layer conv1, "in place" if its inputs are already parts of its output.
  std::string kernel;
  /// "" if not a convolution, else "fastest predicted", "rounding amplified later" (faster kernels
  /// round too much for a later layer), "strict accuracy", "memory limit" (max_run_bytes excludes
  /// faster kernels), "blocking not faster" (few channels, or no AVX2), "reference requested".
  std::string selection_reason;
  bool winograd = false;  ///< the kernel uses Winograd's algorithm
  bool exact = false;     ///< only moves or selects values, or (leaky ReLU) scales each once
  std::vector<Shape> inputs, outputs, weights;  ///< shapes, in the layer's order
  /// Blob names of inputs and outputs in the file; an in-place layer repeats a name.
  std::vector<std::string> input_blobs, blobs;
  int64_t macs = 0;  ///< multiply-accumulates; 0 where not applicable
  /// Multiplications that the kernel executes, in `products`: fewer than macs for Winograd's
  /// algorithm and single-channel inputs.
  int64_t multiplications = 0;
  Precision products = Precision::kFloat32;  ///< number format of the factors
  /// Values and weights that the kernel reads and values that it writes, each counted once;
  /// excludes scratch.
  int64_t read_bytes = 0, written_bytes = 0;
  int64_t parameters = 0;           ///< weights and biases
  int64_t packed_weight_bytes = 0;  ///< copies of the weights in the kernel's order
  int64_t activation_bytes = 0;     ///< memory of the outputs; 0 if shared with the input
  /// Receptive fields of the first output's rows and columns; nullopt if they cover the entire
  /// input or the output is not an image.
  std::optional<ReceptiveField> field_h, field_w;
  std::vector<size_t> input_layers;  ///< indices into Plan::layers()
};

class Run;

/// Kernels and memory layout of a network for given input shapes. Immutable and cheap to copy;
/// keeps the required parts of the net alive. Moving copies, so no plan is left empty.
class Plan {
 public:
  Plan(const Plan&) = default;
  Plan& operator=(const Plan&) = default;
  ~Plan() = default;

  const std::vector<LayerCost>& layers() const;  ///< in execution order
  const std::vector<Port>& inputs() const;       ///< with the planned shapes
  const std::vector<Port>& outputs() const;      ///< in the net's order
  /// All activations and scratch of one run [bytes].
  int64_t arena_bytes() const;
  int64_t weight_bytes() const;  ///< weights of the file that the layers use [bytes]
  /// Size of weight copies in the kernels' order [bytes]. Plans of a net share copies for the same
  /// kernels; the last plan frees them.
  int64_t packed_weight_bytes() const;
  /// Buffers of the arena.
  const std::vector<BufferUse>& buffers() const;

  struct Impl;

 private:
  friend class Net;
  friend class Run;
  explicit Plan(std::shared_ptr<const Impl> impl) : impl_(std::move(impl)) {}
  std::shared_ptr<const Impl> impl_;
};

/// A network with its weights, optionally truncated. Immutable and thread-safe after loading,
/// including plan(). Moving copies, which is cheap, so no net is left empty.
class Net {
 public:
  Net(const Net&) = default;
  Net& operator=(const Net&) = default;
  ~Net() = default;

  /// Reads the needed layers of an original Caffe prototxt and caffemodel. Throws InputError for
  /// files that do not parse or do not match each other. Throws UnsupportedError for a needed layer
  /// of an unsupported type, UsageError for an unknown layer in `end` or `graft`.
  static Net load(const std::filesystem::path& prototxt, const std::filesystem::path& weights,
                  const LoadOptions& options = {});

  /// Loads from the contents of both files, which are needed only during the call. The prototxt
  /// must not be a solver file, because that names another file. Messages use the names
  /// "<prototxt>" and "<weights>".
  static Net load_from_memory(std::string_view prototxt, std::string_view weights,
                              const LoadOptions& options = {});

  /// Loads with seeded random weights (He-scaled Gaussian), for timing and tests.
  static Net load_with_random_weights(const std::filesystem::path& prototxt, uint64_t seed,
                                      const LoadOptions& options = {});

  /// Loads without a weights file. Run throws unless the prototxt itself contains all weights.
  static Net load_without_weights(const std::filesystem::path& prototxt,
                                  const LoadOptions& options = {});

  /// Selects kernels and lays out memory. `inputs` overrides input shapes, by blob name. Throws
  /// InputError for a layer that rejects the shapes, or for more than PlanOptions::max_run_bytes.
  /// Throws UsageError for an unknown input, an unknown layer in PlanOptions::keep, or threads
  /// outside 1 to 1024. Throws MemoryError if there is no memory for the packed weights.
  Plan plan(const std::map<std::string, Shape>& inputs = {}, const PlanOptions& options = {}) const;

  /// The layers from `first` to `last` as a net that shares the weights of this one. Its inputs are
  /// the blobs that they read from earlier layers, by name, with the shapes that follow from this
  /// net's inputs; plan() accepts others. Its outputs are the last values of all blobs that they
  /// compute. Throws UsageError for unknown layers or if `last` comes before `first`.
  Net part(std::string_view first, std::string_view last) const;

  /// The layers that `layers` need, as a net that shares the weights of this one and has all its
  /// inputs. Its outputs are those of `layers`, named by proto::port_name(), before later in-place
  /// layers. Throws UsageError for unknown layers.
  Net truncated(const std::vector<std::string>& layers) const;

  const std::string& name() const;  ///< as in the prototxt
  /// Net inputs with their shapes from the prototxt or LoadOptions::inputs.
  const std::vector<Port>& inputs() const;
  std::vector<std::string> outputs() const;  ///< names, in the order of the prototxt
  /// Names of all inference layers of the file, in order.
  const std::vector<std::string>& layer_names() const;
  /// True if plans can have channel_offsets: one input, read only by convolutions without groups.
  bool takes_single_channel_input() const;
  /// Unused layers of the weights file, upgrades.
  const std::vector<std::string>& warnings() const;
  /// Layers with weights, in file order: name and arrays in the layer's order, e.g. weights and
  /// bias. The views are valid while a copy of this net lives. Throws UsageError if the net was
  /// loaded without weights.
  std::vector<std::pair<std::string, std::vector<View<const float>>>> weights() const;
  uint64_t weight_bytes_read() const;  ///< from the weights file [bytes]
  /// Packed weight copies of the kernels of all living plans [bytes].
  int64_t packed_weight_bytes() const;

  struct Impl;

 private:
  explicit Net(std::shared_ptr<const Impl> impl) : impl_(std::move(impl)) {}
  std::shared_ptr<const Impl> impl_;
};

/// Input blobs of a prototxt, in order. Uses only the reading options.
std::vector<std::string> input_blobs(const std::filesystem::path& prototxt,
                                     const LoadOptions& options = {});

/// Values of a weight blob before training. `filler` is a serialized FillerParameter. Throws
/// InputError for an unknown filler, or one that does not suit the shape.
std::vector<float> filled(std::string_view filler, const Shape& shape, uint64_t seed);

/// Execution context that owns the memory of a plan. Use one per thread; runs of one plan can
/// execute concurrently. Each thread that calls forward() has threads of its own, which end with
/// it; a forked child creates new ones. forward() waits only for threads that have begun to work,
/// so threads that are not scheduled do not delay it. See OneBlasThread in machine.h for the effect
/// on OpenBLAS's threads. A moved-from run can be assigned to or destroyed. Its other functions
/// throw UsageError, and forward() without `observe`, which is noexcept, calls std::terminate.
class Run {
 public:
  /// Allocates Plan::arena_bytes(). Inputs are NaN until filled. Throws UsageError if needed
  /// weights are not loaded, MemoryError if the system refuses memory. With overcommit (Linux), the
  /// system may kill the program later instead, so limit memory by PlanOptions::max_run_bytes.
  explicit Run(Plan plan);
  Run(Run&&) noexcept;             ///< leaves a run that throws, see above
  Run& operator=(Run&&) noexcept;  ///< likewise
  ~Run();

  /// Memory of a net input for the caller to fill; it keeps its values across forward passes.
  /// Throws UsageError for an unknown name.
  View<float> input(std::string_view blob);
  void forward() noexcept;  ///< computes all outputs from the inputs
  /// Calls `observe` before each step (`done` is false) and after it. A layer, an index into
  /// Plan::layers(), can have any number of steps.
  void forward(const std::function<void(size_t layer, bool done)>& observe);
  /// Output of the net. Throws UsageError for an unknown name. If the number of rows depends on the
  /// data (Filter, Proposal, ...), the shape is that of the last pass and can have no rows.
  View<const float> output(std::string_view name) const;
  /// Output of a layer before later in-place layers, by proto::port_name(). Throws UsageError
  /// unless the plan has keep_all or the name in `keep`, because other buffers are overwritten.
  View<const float> layer_output(std::string_view name) const;

  const Plan& plan() const { return plan_; }  ///< the plan it executes

 private:
  struct Memory;
  Memory& memory() const;  ///< throws UsageError when moved from
  Plan plan_;
  std::unique_ptr<Memory> memory_;
};

/// A supported type of layers.
struct LayerType {
  std::string type;    ///< as in the prototxt
  std::string origin;  ///< "Caffe", or the fork it comes from
  std::string does;    ///< description, for display
};

/// Sorted case-insensitively.
std::vector<LayerType> layer_types();

/// Types with weights, for proto::NetReadOptions.
std::set<std::string> types_with_weights();

}  // namespace revisit::engine
