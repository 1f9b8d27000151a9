#pragma once

#include <cstddef>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "revisit/base/error.h"
#include "revisit/engine/precision.h"
#include "revisit/engine/tensor.h"
#include "revisit/proto/limits.h"

namespace revisit::engine {

/// The system refused memory; the message says how much and for what.
class MemoryError : public Error {
  using Error::Error;
};

/// Where to cut a network off. Layers beyond are never looked at and their weights are not read.
struct Truncation {
  /// The layer whose output is wanted, before in-place layers that follow. Empty: the whole net.
  std::string end;
  /// A layer without weights (e.g. "pool5") to append to `end`, the layers in place on it, and its
  /// BatchNorm, Scale and ReLU: the paper's "conv3+pool5". Of these three one that is not in place
  /// is left out, with a warning, when other layers read the same value, too.
  std::string graft;

  /// The name of the output: "conv3", "conv3+pool5", or "" for the whole net.
  std::string name() const { return graft.empty() ? end : end + "+" + graft; }
};

struct LoadOptions {
  Truncation truncation;
  /// Shapes of net inputs that replace those in the prototxt, by blob name.
  std::map<std::string, Shape> inputs;
  /// Layers without weights in the file become zeros instead of an error.
  bool allow_missing = false;
  /// Unknown fields beside the parameters of layers become warnings instead of errors.
  bool allow_unknown = false;
  /// What the files may ask for. A prototxt of a few lines can ask for any amount of weights: more
  /// than `limits.weight_bytes` in memory are refused, too, before they are allocated.
  proto::Limits limits;
};

/// A tensor of the net that has a name outside: an input or an output.
struct Port {
  std::string name;
  Shape shape;  // the largest, where the number of rows depends on the data
};

/// How much kernels may round beyond a plain sum in float32: a limit of the tiles of Winograd's
/// algorithm. The larger, the faster, and the more it rounds. Errors of nets: docs/ACCURACY.md.
enum class Accuracy {
  /// The fastest kernel; before layers that amplify rounding (BatchNorm, MVN that divides by the
  /// deviation, a Softmax of maps that nothing averaged) tiles of at most 4x4 outputs. For nets
  /// without such layers within 1e-5 of Caffe (largest error / largest value of any layer).
  kUsual,
  /// Tiles of at most 4x4 everywhere: about what Caffe's own products round.
  kStrict,
};

struct PlanOptions {
  /// Threads of one forward pass, 1 to 1024. The result does not depend on it, bit for bit.
  int threads = 1;
  /// Keep the output of every layer, not only the net's outputs: nothing is merged with anything.
  bool keep_all = false;
  /// Layers whose outputs are kept beside the net's, by port_name(), for Run::layer_output(). Only
  /// what would write over them is not merged.
  std::vector<std::string> keep = {};
  /// No SIMD, no OpenBLAS, nothing merged: the truth that fast kernels are tested against.
  /// Convolutions, inner products, LRN across channels, LSTM, RNN, softmaxes and activations have
  /// a slow, readable kernel, "reference" in LayerCost::kernel. All other types have one kernel on
  /// plain values, a plain loop, which runs here, too.
  bool reference_kernels = false;
  /// Limit of what one run takes beside the weights of the file [bytes]: Plan::arena_bytes() plus
  /// Plan::packed_weight_bytes(), with what other plans of the net share. Where the fastest kernels
  /// take more, all kernels read the weights as they are. A plan that takes more even so is refused
  /// before any of it is allocated.
  int64_t max_run_bytes = int64_t{8} << 30;
  /// Numbers below 1.2e-38 in magnitude (denormals) count as zero while a pass runs. Caffe keeps
  /// them. On x86 each costs some hundred cycles: an LSTM whose gates have closed takes 13 times as
  /// long, a net faded to nothing 55 times. The difference is below any error of rounding, but the
  /// logarithm of such a probability is -infinity. The calling thread's mode is restored.
  bool flush_denormals = true;
  Accuracy accuracy = Accuracy::kUsual;
  /// Not with reference_kernels, which compute in float32.
  Precision precision = Precision::kFloat32;
  /// Also with float32: the weights of inner products of up to 8 inputs in bfloat16, which halves
  /// the time where reading them takes most of it. They are in memory beside the file's.
  bool bf16_weights = false;
  /// Of a Dropout that drops at inference, too (sample_weights_test): a run's passes differ, but
  /// are the same for every run.
  uint64_t seed = 0;
  /// The caller promises that all channels of the net's only image input are one picture, up to a
  /// constant: channel c is the picture plus gray_offsets[c]. The run's input then is the picture,
  /// of one channel, and the first convolution is that much cheaper.
  std::optional<std::vector<float>> gray_offsets = {};
};

/// Which pixels of the net's input an output pixel can see, along one axis: output pixel i sees the
/// input pixels [start + i * stride, start + i * stride + size). A negative start is padding.
struct ReceptiveField {
  int64_t size = 1, stride = 1, start = 0;
  friend bool operator==(const ReceptiveField&, const ReceptiveField&) = default;
};

/// A buffer of the arena: which floats it takes and while which layers run.
struct BufferUse {
  std::string what;  // the layer whose output or scratch it is
  int64_t offset_bytes = 0, bytes = 0;
  size_t first_layer = 0,
         last_layer = 0;  // indices into Plan::layers(); last may be one past the end
};

/// The rule that chose the kernel of a convolution.
enum class KernelReason {
  kNone,              // not a convolution
  kFastest,           // the smallest predicted time
  kAmplified,         // a faster one would round too much for a layer that amplifies rounding
  kStrict,            // Accuracy::kStrict ruled out a faster one
  kMemoryLimit,       // PlanOptions::max_run_bytes did
  kNotWorthBlocking,  // few channels, or a CPU without AVX2
  kReference,         // PlanOptions::reference_kernels
};
/// Its words, "" for kNone.
const char* text_of(KernelReason reason);

/// What one layer is and costs under a plan.
struct LayerCost {
  std::string name, type;
  /// For people: "" when the layer is only another view of its input, "in conv1" when layer conv1
  /// does its work, "in place" when its inputs lie in its output already.
  std::string kernel;
  KernelReason why = KernelReason::kNone;
  bool winograd = false;  // the kernel is Winograd's algorithm
  bool exact = false;     // only moves or chooses values, or (leaky ReLU) scales each once
  std::vector<Shape> inputs, outputs, weights;
  /// What the file calls the inputs and the outputs; an in-place layer repeats a name.
  std::vector<std::string> input_blobs, blobs;
  int64_t macs = 0;  // multiply-accumulates; 0 where the notion does not apply
  /// Multiplications of `products` by its kernel: fewer by Winograd's algorithm, of a gray input.
  int64_t multiplications = 0;
  Precision products = Precision::kFloat32;
  /// What its kernel reads, weights too, and writes, each number once; not what it keeps between.
  int64_t read_bytes = 0, written_bytes = 0;
  int64_t parameters = 0;           // weights and biases
  int64_t packed_weight_bytes = 0;  // its weights once more, in the order its kernel wants
  int64_t activation_bytes = 0;     // memory of its outputs; 0 when they share their input's
  /// Of the rows and columns of the first output; absent when it sees all, or is no image.
  std::optional<ReceptiveField> field_h, field_w;
  std::vector<size_t> input_layers;  // indices of the layers that its inputs come from
};

/// The weights of a layer: its arrays as the layer orders them, e.g. weights and bias.
struct LayerWeights {
  std::string layer;
  std::vector<View<const float>> blobs;
};

class Run;

/// How one network runs on inputs of given shapes: kernels chosen, memory laid out. Immutable and
/// cheap to copy; keeps what it needs of the net alive. Moving copies: no plan is left empty.
class Plan {
 public:
  Plan(const Plan&) = default;
  Plan& operator=(const Plan&) = default;
  ~Plan() = default;

  const std::vector<LayerCost>& layers() const;
  const std::vector<Port>& inputs() const;
  const std::vector<Port>& outputs() const;
  /// All activations and scratch of one run [bytes]: the size of the arena.
  int64_t arena_bytes() const;
  /// The weights of the file [bytes].
  int64_t weight_bytes() const;
  /// What kernels hold in an order of their own, beside the weights [bytes]. All plans of a net
  /// share it where they use the same kernels; it goes with the last of them.
  int64_t packed_weight_bytes() const;
  /// The arena, buffer by buffer.
  const std::vector<BufferUse>& buffers() const;

  struct Impl;

 private:
  friend class Net;
  friend class Run;
  explicit Plan(std::shared_ptr<const Impl> impl) : impl_(std::move(impl)) {}
  std::shared_ptr<const Impl> impl_;
};

/// A network with its weights, cut off where asked. Immutable after loading; share it freely, also
/// between threads that plan. Moving copies, which is cheap, so no net is left without content.
class Net {
 public:
  Net(const Net&) = default;
  Net& operator=(const Net&) = default;
  ~Net() = default;

  /// Reads an original Caffe prototxt and caffemodel; only the layers that are needed. Throws
  /// InputError (files that do not parse or do not fit each other), UnsupportedError (a layer type
  /// that is needed and not supported), UsageError (an unknown layer in the truncation).
  static Net load(const std::filesystem::path& prototxt, const std::filesystem::path& weights,
                  const LoadOptions& options = {});

  /// The same of what the two files hold, which is needed during the call only. The prototxt cannot
  /// be a solver file, which names another file; messages call the two <prototxt> and <weights>.
  static Net load_from_memory(std::string_view prototxt, std::string_view weights,
                              const LoadOptions& options = {});

  /// The same with seeded random weights (He-scaled uniform): for timing and tests.
  static Net load_with_random_weights(const std::filesystem::path& prototxt, uint64_t seed,
                                      const LoadOptions& options = {});

  /// The same without a file: unless the prototxt itself has all weights, a Run of it throws.
  static Net load_without_weights(const std::filesystem::path& prototxt,
                                  const LoadOptions& options = {});

  /// Chooses kernels and lays out memory. `inputs` replaces input shapes by blob name. Throws
  /// InputError (a layer that cannot take the shapes, more than PlanOptions::max_run_bytes),
  /// UsageError (an unknown input, an unknown layer in PlanOptions::keep, a number of threads
  /// outside 1 to 1024), MemoryError (no memory for the packed weights).
  Plan plan(const std::map<std::string, Shape>& inputs = {}, const PlanOptions& options = {}) const;

  const std::string& name() const;
  /// Net inputs with the shapes of the prototxt (or of LoadOptions::inputs).
  const std::vector<Port>& inputs() const;
  /// Names of the outputs.
  std::vector<std::string> outputs() const;
  /// Names of all layers of the file that belong to inference, in order.
  const std::vector<std::string>& layer_names() const;
  /// Whether plans can have gray_offsets: one input, which only convolutions without groups read.
  bool takes_gray_input() const;
  /// Warnings for the user: unused layers of the weights file, upgrades made.
  const std::vector<std::string>& warnings() const;
  /// The weights of the layers that have some, in the order of the file; they live as long as a
  /// copy of this net. Throws UsageError for a net without weights.
  std::vector<LayerWeights> weights() const;
  /// Bytes read from the weights file.
  uint64_t weight_bytes_read() const;
  /// Weights that the kernels of all living plans hold in orders of their own [bytes].
  int64_t packed_weight_bytes() const;

  struct Impl;

 private:
  explicit Net(std::shared_ptr<const Impl> impl) : impl_(std::move(impl)) {}
  std::shared_ptr<const Impl> impl_;
};

/// Names of the input blobs of a prototxt, in order. Only options about reading it are used.
std::vector<std::string> input_blobs(const std::filesystem::path& prototxt,
                                     const LoadOptions& options = {});

/// The name of output `port` of a layer in a run with keep_all: "slice", "slice.1", "slice.2", ...
std::string port_name(const std::string& layer, size_t port);

/// Called around each step of an instrumented forward pass; a layer can have none or several.
class StepObserver {
 public:
  virtual ~StepObserver() = default;
  virtual void before(size_t layer) = 0;  // index into Plan::layers()
  virtual void after(size_t layer) = 0;
};

/// One execution context: owns the memory of a plan. Use one per thread; several runs of one plan
/// may work at the same time. Threads are OpenMP's, a team for each thread that calls forward();
/// fork() ends that of the thread that calls it, so that parent and child both make new ones.
/// What matrix products do to OpenBLAS's threads: OneBlasThread in blas.h. A run that was moved
/// from may be assigned to or destroyed; all else throws UsageError, and forward() without an
/// observer, which cannot throw, ends the program with it (std::terminate).
class Run {
 public:
  /// Allocates the arena, Plan::arena_bytes(). Its inputs are NaN until they are filled. Throws
  /// UsageError when the net has no weights but needs some, MemoryError when the system has no
  /// memory for it. A system that promises more than it has (Linux's overcommit) may end the
  /// program later instead: PlanOptions::max_run_bytes is the limit that always holds.
  explicit Run(Plan plan);
  Run(Run&&) noexcept;
  Run& operator=(Run&&) noexcept;
  ~Run();

  /// The memory of a net input, to be filled; it keeps its values over forward passes.
  /// Throws UsageError for an unknown name.
  View<float> input(std::string_view blob);
  void forward() noexcept;
  void forward(StepObserver& observer);
  /// An output of the net. Throws UsageError for an unknown name. Where the number of rows depends
  /// on the data (Filter, Proposal, ...) the shape is that of the last pass; it can have no rows.
  View<const float> output(std::string_view name) const;
  /// Output of a layer before later ones work on it in place, by port_name(). Throws UsageError
  /// unless planned with keep_all, or with the name in keep, so stale data is never seen.
  View<const float> layer_output(std::string_view name) const;

  const Plan& plan() const { return plan_; }

 private:
  struct Memory;
  Memory& memory() const;  // throws UsageError when moved from
  Plan plan_;
  std::unique_ptr<Memory> memory_;
};

}  // namespace revisit::engine
