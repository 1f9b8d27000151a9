#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string_view.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include <filesystem>

#include "arrays.h"
#include "module.h"
#include "revisit/engine/net.h"
#include "revisit/proto/net_file.h"
#include "run.h"
#include "unlocked.h"

namespace revisit::python {
namespace {

namespace fs = std::filesystem;
using namespace nb::literals;
using engine::Net;
using engine::Plan;

using Shapes = std::map<std::string, std::vector<int64_t>>;
using ShapeDict = nb::typed<nb::dict, nb::str, ShapeTuple>;
using WeightDict = nb::typed<nb::dict, nb::str, nb::typed<nb::list, ReadOnlyFloats>>;

std::map<std::string, engine::Shape> shapes_from(const Shapes& given) {
  std::map<std::string, engine::Shape> shapes;
  for (const auto& [name, axes] : given) shapes.emplace(name, engine::Shape(axes));
  return shapes;
}

ShapeDict dict_of(const std::vector<engine::Port>& ports) {
  nb::dict shapes;
  for (const engine::Port& port : ports) shapes[text_of(port.name)] = tuple_of(port.shape.axes());
  return nb::borrow<ShapeDict>(shapes);
}

nb::typed<nb::list, ShapeTuple> tuples_of(const std::vector<engine::Shape>& shapes) {
  nb::list list;
  for (const engine::Shape& shape : shapes) list.append(tuple_of(shape.axes()));
  return nb::borrow<nb::typed<nb::list, ShapeTuple>>(list);
}

/// Every array is a view of the net and keeps it alive.
WeightDict weights_of(nb::handle self) {
  const Net& net = nb::cast<const Net&>(self);
  nb::dict weights;
  for (const auto& [layer, arrays] : net.weights()) {
    nb::list blobs;
    for (const engine::View<const float>& blob : arrays)
      blobs.append(view_of(blob.data, blob.shape.axes(), self));
    weights[text_of(layer)] = blobs;
  }
  return nb::borrow<WeightDict>(weights);
}

/// Declares a static function of Net with its own arguments and the keywords of LoadOptions. `load`
/// runs without the GIL.
template <class... Given, class Load, class... Names>
void def_load(nb::class_<Net>& net, const char* name, const Load& load, const char* doc,
              const Names&... names) {
  net.def_static(
      name,
      [load](Given... given, std::string end, std::string graft, const Shapes& inputs,
             bool allow_missing, uint64_t fill_seed, bool allow_unknown,
             const std::optional<proto::Limits>& limits) {
        const engine::LoadOptions options{.end = std::move(end),
                                          .graft = std::move(graft),
                                          .inputs = shapes_from(inputs),
                                          .allow_missing = allow_missing,
                                          .fill_seed = fill_seed,
                                          .allow_unknown = allow_unknown,
                                          .limits = limits.value_or(proto::Limits())};
        return without_lock([&] { return load(given..., options); });
      },
      names..., nb::kw_only(), "end"_a = "", "graft"_a = "", "inputs"_a = Shapes(),
      "allow_missing"_a = false, "fill_seed"_a = 0, "allow_unknown"_a = false,
      "limits"_a = nb::none(), doc);
}

Net load(const fs::path& prototxt, const std::optional<fs::path>& weights,
         const engine::LoadOptions& options) {
  if (weights) return Net::load(prototxt, *weights, options);
  Net net = Net::load_without_weights(prototxt, options);
  try {
    (void)net.weights();
  } catch (const UsageError&) {
    throw UsageError(
        "Net.load() needs a weights file after the prototxt; without one, "
        "Net.load_without_weights(prototxt) can be planned and inspected, and "
        "Net.load_with_random_weights(prototxt, seed) can run");
  }
  return net;
}

void bind_loading(nb::class_<Net>& net) {
  def_load<const fs::path&, const std::optional<fs::path>&>(
      net, "load", load,
      "Reads an original Caffe prototxt and its weights (.caffemodel or HDF5), for the needed "
      "layers only. A prototxt that contains all weights needs no weights file.\n\n"
      "end: last layer of a truncated net; '' for the full net.\n"
      "graft: a layer without weights to append to it ('pool5': the paper's conv3+pool5).\n"
      "inputs: input shapes that replace those of the prototxt.\n"
      "allow_missing: fill weights that the file lacks as Caffe does before training.\n"
      "fill_seed: of random fillers.\n"
      "allow_unknown: warn about unknown fields outside layer parameters instead of raising.\n"
      "Raises InputError (files do not parse or do not match), UnsupportedError (unsupported layer "
      "type), UsageError (unknown layer).",
      "prototxt"_a, "weights"_a = nb::none());
  def_load<const std::string&, const nb::bytes&>(
      net, "load_from_memory",
      [](const std::string& prototxt, const nb::bytes& weights, const auto& options) {
        return Net::load_from_memory(prototxt, bytes_of(weights), options);
      },
      "Like load(), from the content of the files: text of the prototxt, and bytes of a "
      ".caffemodel or HDF5 file. Raises as load().",
      "prototxt"_a, "weights"_a);
  def_load<const fs::path&, uint64_t>(
      net, "load_with_random_weights", Net::load_with_random_weights,
      "Like load(), with seeded random weights, for timing and tests. Raises as load().",
      "prototxt"_a, "seed"_a);
  def_load<const fs::path&>(
      net, "load_without_weights", Net::load_without_weights,
      "Like load(), without a weights file. Unless the prototxt contains all weights, the net can "
      "be planned and inspected, but creating a Run raises UsageError.",
      "prototxt"_a);
}

void bind_net(nb::module_& module) {
  nb::class_<Net> bound(
      module, "Net",
      "A network with its weights, optionally truncated. Immutable and thread-safe.");
  bind_loading(bound);
  bound
      .def(
          "plan",
          [](const Net& net, const Shapes& inputs, int threads, bool keep_all,
             std::vector<std::string> keep, bool reference_kernels, int64_t max_run_bytes,
             bool flush_denormals, bool strict_accuracy, engine::Precision precision,
             bool bf16_weights, uint64_t seed, std::optional<std::vector<float>> channel_offsets) {
            const engine::PlanOptions options{.threads = threads,
                                              .keep_all = keep_all,
                                              .keep = std::move(keep),
                                              .reference_kernels = reference_kernels,
                                              .max_run_bytes = max_run_bytes,
                                              .flush_denormals = flush_denormals,
                                              .strict_accuracy = strict_accuracy,
                                              .precision = precision,
                                              .bf16_weights = bf16_weights,
                                              .seed = seed,
                                              .channel_offsets = std::move(channel_offsets)};
            return net.plan(shapes_from(inputs), options);
          },
          nb::call_guard<Unlocked>(), "inputs"_a = Shapes(), nb::kw_only(),
          "threads"_a = engine::PlanOptions().threads, "keep_all"_a = false,
          "keep"_a = std::vector<std::string>(), "reference_kernels"_a = false,
          "max_run_bytes"_a = engine::PlanOptions().max_run_bytes, "flush_denormals"_a = true,
          "strict_accuracy"_a = false, "precision"_a = engine::Precision::kFloat32,
          "bf16_weights"_a = false, "seed"_a = 0, "channel_offsets"_a = nb::none(),
          "Chooses kernels and plans the memory.\n\n"
          "inputs: shapes by blob name; other inputs keep the shapes of the prototxt.\n"
          "threads: of one forward pass. Results are bitwise independent of it.\n"
          "keep_all: keep the output of every layer for Run.layer_output(). keep: only of these.\n"
          "max_run_bytes: memory limit of one run, without the weights.\n"
          "flush_denormals: flush numbers below 1.2e-38 to zero during a pass.\n"
          "strict_accuracy: at most about the rounding of Caffe's matrix products.\n"
          "precision: data type of activations and weights.\n"
          "bf16_weights: store weights of inner products in bfloat16, even with FLOAT32.\n"
          "seed: of Dropout layers that are active at inference (sample_weights_test).\n"
          "channel_offsets: the caller guarantees channel c == channel 0 + channel_offsets[c]; the "
          "input then has one channel.\n"
          "Raises InputError with the layer that cannot take the shapes, UsageError for unknown "
          "names, MemoryError.")
      .def("part", &Net::part, nb::call_guard<Unlocked>(), "first"_a, "last"_a,
           "Returns the layers from `first` to `last` as a net that shares the weights. Inputs: "
           "the blobs that they read from earlier layers. Outputs: all blobs that they compute. "
           "Raises UsageError for unknown layers or if `last` comes before `first`.")
      .def("truncated", &Net::truncated, nb::call_guard<Unlocked>(), "layers"_a,
           "Returns the layers that `layers` need, as a net that shares the weights and has all "
           "inputs. Outputs: those of `layers`, by port_name(), before later in-place layers. "
           "Raises UsageError for unknown layers.")
      .def_prop_ro("name", &Net::name, "Name of the net in the prototxt.")
      .def_prop_ro(
          "inputs", [](const Net& net) { return dict_of(net.inputs()); },
          "Input shapes by blob name, as in the prototxt.")
      .def_prop_ro("outputs", &Net::outputs, "Names of the outputs.")
      .def_prop_ro("layer_names", &Net::layer_names,
                   "Names of all inference layers of the file, in order.")
      .def_prop_ro("takes_single_channel", &Net::takes_single_channel_input,
                   "plan(channel_offsets=...) is supported.")
      .def_prop_ro("warnings", &Net::warnings,
                   "Warnings: skipped or unused layers, upgrades of old formats.")
      .def_prop_ro("weights", &weights_of,
                   "layer -> arrays (weights, bias ...), as read-only views. Raises UsageError for "
                   "a net without weights.")
      .def("__repr__", [](const Net& net) {
        return str("<revisit.engine.Net '", net.name(), "', ", net.layer_names().size(),
                   " layers>");
      });
}

void bind_plan(nb::module_& module) {
  using engine::LayerCost;
  using engine::ReceptiveField;
  nb::class_<ReceptiveField>(module, "ReceptiveField",
                             "Output pixel i sees the input pixels [start + i * stride, start + i "
                             "* stride + size). A negative start is padding.")
      .def_ro("size", &ReceptiveField::size, "Input pixels that an output pixel sees.")
      .def_ro("stride", &ReceptiveField::stride,
              "Input pixels between the windows of neighboring output pixels.")
      .def_ro("start", &ReceptiveField::start,
              "First input pixel of output pixel 0; negative in the padding.")
      .def("__repr__", [](const ReceptiveField& field) {
        return str("ReceptiveField(size=", field.size, ", stride=", field.stride,
                   ", start=", field.start, ")");
      });
  nb::class_<LayerCost>(module, "LayerCost", "One layer of a plan, with its cost.")
      .def_ro("name", &LayerCost::name, "Name of the layer.")
      .def_ro("type", &LayerCost::type, "Type of the layer, e.g. 'Convolution'.")
      .def_ro("kernel", &LayerCost::kernel,
              "Name of the kernel; '' for a view of the input, 'in conv1' if fused into conv1.")
      .def_ro("selection_reason", &LayerCost::selection_reason,
              "Rule that selected the kernel of a convolution.")
      .def_prop_ro(
          "inputs", [](const LayerCost& cost) { return tuples_of(cost.inputs); },
          "Shapes of the inputs.")
      .def_prop_ro(
          "outputs", [](const LayerCost& cost) { return tuples_of(cost.outputs); },
          "Shapes of the outputs.")
      .def_ro("blobs", &LayerCost::blobs, "Names of the outputs in the file.")
      .def_ro("macs", &LayerCost::macs, "Multiply-accumulates; 0 where not applicable.")
      .def_ro("parameters", &LayerCost::parameters, "Weights and biases.")
      .def_ro("packed_weight_bytes", &LayerCost::packed_weight_bytes,
              "Copies of the weights in the kernel's layout [bytes].")
      .def_ro("activation_bytes", &LayerCost::activation_bytes,
              "Memory of the outputs [bytes]; 0 if shared with the input.")
      .def_ro("field_h", &LayerCost::field_h,
              "Vertical receptive field of the first output, or None.")
      .def_ro("field_w", &LayerCost::field_w, "Horizontal receptive field, or None.")
      .def_ro("input_layers", &LayerCost::input_layers, "Indices into Plan.layers.")
      .def("__repr__", [](const LayerCost& cost) {
        return str("<LayerCost '", cost.name, "' ", cost.type, ", ", cost.macs, " MACs>");
      });
  nb::class_<Plan>(module, "Plan",
                   "Kernels and memory layout of a network for given input shapes. Immutable.")
      .def_prop_ro("layers", &Plan::layers, nb::rv_policy::copy, "Layers in execution order.")
      .def_prop_ro(
          "inputs", [](const Plan& plan) { return dict_of(plan.inputs()); },
          "Input shapes by blob name.")
      .def_prop_ro(
          "outputs", [](const Plan& plan) { return dict_of(plan.outputs()); },
          "Output shapes by name.")
      .def_prop_ro("arena_bytes", &Plan::arena_bytes, "Activations and scratch of one run [bytes].")
      .def_prop_ro("weight_bytes", &Plan::weight_bytes, "Weights of the file [bytes].")
      .def_prop_ro("packed_weight_bytes", &Plan::packed_weight_bytes,
                   "Additional copies of weights in the layouts of kernels [bytes].")
      .def(
          "run", [](const Plan& plan) { return std::make_unique<Run>(plan); },
          "Creates a Run of this plan.");
}

}  // namespace

void bind_engine(nb::module_& module) {
  nb::enum_<engine::Precision>(module, "Precision", "Data type of activations and weights.")
      .value("FLOAT32", engine::Precision::kFloat32, "32-bit floats.")
      .value("BF16", engine::Precision::kBf16,
             "bfloat16; sums, normalization and values in NCHW layout stay in float32.");
  bind_net(module);
  bind_plan(module);
  bind_run(module);

  module.def("port_name", &proto::port_name, "layer"_a, "port"_a,
             "Name of a layer's output for Run.layer_output(): 'slice', 'slice.1', ...");
  module.def(
      "filled",
      [](const nb::bytes& filler, const std::vector<int64_t>& shape, uint64_t seed) {
        return array_of(engine::filled(bytes_of(filler), engine::Shape(shape), seed), shape);
      },
      "filler"_a, "shape"_a, "seed"_a,
      "Values of a weight blob before training, float32 of `shape`. filler: a serialized "
      "FillerParameter. Raises InputError for an unknown filler, or one that does not suit the "
      "shape.");
  module.def(
      "layer_types",
      [] {
        std::map<std::string, std::string> types;
        for (const engine::LayerType& type : engine::layer_types()) types[type.type] = type.does;
        return types;
      },
      "Returns supported layer type -> description.");
}

}  // namespace revisit::python
