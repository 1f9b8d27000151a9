#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include <filesystem>
#include <mutex>
#include <optional>

#include "arrays.h"
#include "module.h"
#include "revisit/base/files.h"
#include "revisit/engine/net.h"
#include "revisit/proto/net_file.h"
#include "revisit/proto/weights_file.h"
#include "unlocked.h"

namespace revisit::python {
namespace {

namespace fs = std::filesystem;
using namespace nb::literals;
using proto::Blob;
using proto::Limits;
using proto::NetFile;
using proto::WeightsFile;
using OptionalArray = std::optional<FloatArray>;

nb::bytes bytes_from(const std::string& content) {
  return nb::bytes(content.data(), content.size());
}
/// Returns nullopt for a blob that the file lacks.
OptionalArray array_from(Blob blob) {
  if (blob.absent) return std::nullopt;
  const std::vector<int64_t> shape = blob.shape;
  return array_of(std::move(blob.data), shape);
}

/// Thread-safe.
class SharedWeightsFile {
 public:
  explicit SharedWeightsFile(std::unique_ptr<WeightsFile> file, nb::object content = nb::none())
      : content_(std::move(content)), file_(std::move(file)) {}

  std::vector<std::pair<std::string, size_t>> layers() const {
    std::vector<std::pair<std::string, size_t>> layers;
    for (const WeightsFile::Layer& layer : file_->layers())
      layers.emplace_back(layer.name, layer.n_blobs);
    return layers;
  }

  std::vector<OptionalArray> read(size_t index) {
    if (index >= file_->layers().size())
      throw nb::index_error(str("layer ", index, " of ", file_->layers().size()).c_str());
    std::vector<Blob> blobs = without_lock([&] {
      const std::lock_guard lock(mutex_);
      return file_->read(index);
    });
    std::vector<OptionalArray> arrays;
    for (Blob& blob : blobs) arrays.push_back(array_from(std::move(blob)));
    return arrays;
  }

 private:
  nb::object content_;  // keeps the bytes of a file in memory alive
  std::mutex mutex_;
  std::unique_ptr<WeightsFile> file_;
};

proto::NetReadOptions read_options(bool allow_unknown_fields, bool keep_unread, bool keep_training,
                                   bool keep_python, const std::optional<Limits>& limits,
                                   bool train = false, int level = 0,
                                   std::vector<std::string> stages = {}) {
  return {.allow_unknown_fields = allow_unknown_fields,
          .keep_unread = keep_unread,
          .keep_training = keep_training,
          .keep_python = keep_python,
          .train = train,
          .level = level,
          .stages = std::move(stages),
          .types_with_weights = engine::types_with_weights(),
          .limits = limits.value_or(Limits())};
}

void set_blobs(caffe::LayerParameter& layer, nb::handle arrays) {
  layer.clear_blobs();
  for (const nb::handle given : arrays) {
    const auto array = contiguous_floats(given, "weights of layer '" + layer.name() + "'");
    caffe::BlobProto& blob = *layer.add_blobs();
    blob.mutable_shape();  // of scalars, too
    for (const int64_t axis : shape_of(array)) blob.mutable_shape()->add_dim(axis);
    blob.mutable_data()->Add(array.data(), array.data() + array.size());
  }
}

void set_weights(NetFile& file,
                 const nb::typed<nb::dict, nb::str, nb::typed<nb::sequence, FloatArray>>& weights) {
  for (const auto& [key, arrays] : weights) {
    const std::string name = name_from(key, "weights");
    std::vector<std::string> names;
    bool found = false;
    for (caffe::LayerParameter& layer : *file.net.mutable_layer()) {
      names.push_back(layer.name());
      if (layer.name() != name) continue;
      set_blobs(layer, arrays);
      found = true;
    }
    if (!found)
      throw UsageError("set_weights: no layer '", name, "'", nearest_name_hint(name, names));
  }
}

NetFile net_of_layers(const std::string& name,
                      const std::vector<std::pair<nb::bytes, nb::list>>& layers) {
  NetFile file;
  file.net.set_name(name);
  for (const auto& [message, arrays] : layers) {
    caffe::LayerParameter& layer = *file.net.add_layer();
    if (!layer.ParsePartialFromString(std::string(bytes_of(message))))
      throw InputError("net_of_layers: expected serialized LayerParameters");
    set_blobs(layer, arrays);
  }
  return file;
}

void bind_graph(nb::module_& module) {
  using proto::Graph;
  using proto::Node;
  nb::class_<Node>(module, "Node", "A layer with the values that its blob names mean.")
      .def_ro("name", &Node::name, "Name of the layer.")
      .def_ro("type", &Node::type, "Type of the layer.")
      .def_ro("index", &Node::index,
              "Position in the net; -1: an inserted Split that shows its first input, which an "
              "in-place layer wrote, in the shape of its second input, which shares its memory.")
      .def_ro("inputs", &Node::inputs,
              "Indices of values; -1 for a blob that no earlier layer writes.")
      .def_ro("outputs", &Node::outputs, "Indices of values.");
  nb::class_<Graph>(module, "Graph",
                    "A net whose values are written once: in-place layers write new values.")
      .def_ro("nodes", &Graph::nodes, nb::rv_policy::copy, "Layers in execution order.")
      .def_prop_ro(
          "values",
          [](const Graph& graph) {
            std::vector<std::pair<std::string, int>> values;
            for (const proto::Value& value : graph.values)
              values.emplace_back(value.blob, value.memory);
            return values;
          },
          "Blob name of each value, and the first value in the memory where Caffe stores it.")
      .def_ro("outputs", &Graph::outputs, "Names and indices of values.")
      .def_ro("warnings", &Graph::warnings, "Messages about the graft of pruned().")
      .def("pruned", &proto::prune, "end"_a = "", "graft"_a = "",
           "Returns the graph without layers that the outputs do not need; see engine.Net.load(). "
           "Raises UsageError for unknown layers, InputError for an input that no layer writes.");
  module.def(
      "resolve",
      [](const nb::bytes& net) {
        const std::string_view content = bytes_of(net);
        return without_lock([&] {
          caffe::NetParameter parsed;
          if (!parsed.ParseFromString(std::string(content)))
            throw InputError("resolve: expected a serialized NetParameter");
          return proto::resolve(parsed);
        });
      },
      "net"_a,
      "Resolves the blob names of a serialized NetParameter in the current format. Raises "
      "InputError for other bytes.");
}

void bind_net_file(nb::module_& module) {
  nb::class_<NetFile>(module, "NetFile",
                      "A network description (NetParameter) in Caffe's current format, V2; with "
                      "weights if it was read from a caffemodel.")
      .def_ro("warnings", &NetFile::warnings, "Warnings about upgrades and skipped content.")
      .def_prop_ro(
          "name", [](const NetFile& file) { return file.net.name(); }, "Name of the net.")
      .def_prop_ro(
          "layers",
          [](const NetFile& file) {
            std::vector<std::pair<std::string, std::string>> layers;
            for (const caffe::LayerParameter& layer : file.net.layer())
              layers.emplace_back(layer.name(), layer.type());
            return layers;
          },
          "Name and type of each layer.")
      .def("set_weights", &set_weights, "weights"_a,
           "Sets the arrays (float32, C order) of layers by name; other layers keep theirs. Raises "
           "UsageError for an unknown layer.")
      .def(
          "text", [](const NetFile& file) { return proto::net_text(file.net); },
          "Returns the prototxt.")
      .def(
          "to_bytes", [](const NetFile& file) { return bytes_from(proto::net_bytes(file.net)); },
          "Returns the content of a caffemodel, which protobuf for Python reads with schema().")
      .def(
          "write_text",
          [](const NetFile& file, const fs::path& path) { proto::write_net_text(path, file.net); },
          "path"_a, "Writes a prototxt atomically. Raises Error if it cannot be written.")
      .def(
          "write_binary",
          [](const NetFile& file, const fs::path& path) {
            proto::write_net_binary(path, file.net);
          },
          "path"_a, "Writes a caffemodel atomically. Raises Error if it cannot be written.");
  module.def(
      "read_net",
      [](const fs::path& prototxt, bool allow_unknown_fields, bool keep_unread, bool keep_training,
         bool keep_python, const std::optional<Limits>& limits, bool train, int level,
         std::vector<std::string> stages) {
        return proto::read_net(
            prototxt, read_options(allow_unknown_fields, keep_unread, keep_training, keep_python,
                                   limits, train, level, std::move(stages)));
      },
      nb::call_guard<Unlocked>(), "prototxt"_a, nb::kw_only(), "allow_unknown_fields"_a = false,
      "keep_unread"_a = false, "keep_training"_a = false, "keep_python"_a = false,
      "limits"_a = nb::none(), "train"_a = false, "level"_a = 0,
      "stages"_a = std::vector<std::string>(),
      "Reads a prototxt of any generation, upgrades it and selects the layers of the phase TEST, "
      "or TRAIN if `train`, and of the level and stages.\n\n"
      "keep_unread: skip fields of layers that do not parse instead of raising, for a net that is "
      "loaded truncated before these layers.\n"
      "keep_training: keep all layers.\n"
      "keep_python: keep layers of type Python, for a caller that runs them.\n\nRaises InputError "
      "with file, line and column.");
  module.def(
      "parse_net",
      [](const std::string& text, const std::string& name, bool allow_unknown_fields,
         bool keep_training, bool keep_python, const std::optional<Limits>& limits) {
        return proto::parse_net(
            text, name,
            read_options(allow_unknown_fields, false, keep_training, keep_python, limits));
      },
      nb::call_guard<Unlocked>(), "text"_a, "name"_a = "<prototxt>", nb::kw_only(),
      "allow_unknown_fields"_a = false, "keep_training"_a = false, "keep_python"_a = false,
      "limits"_a = nb::none(),
      "Like read_net(), from text; `name` replaces the path in messages. Raises as read_net().");
  module.def(
      "read_net_binary",
      [](const fs::path& file, const std::optional<Limits>& limits) {
        return proto::read_net_binary(file, limits.value_or(Limits()));
      },
      nb::call_guard<Unlocked>(), "file"_a, nb::kw_only(), "limits"_a = nb::none(),
      "Reads a full caffemodel, including weights, and upgrades it. Raises InputError if the file "
      "is none or exceeds a limit.");
  module.def("net_of_layers", &net_of_layers, "name"_a, "layers"_a,
             "Returns a net of layers in the current format: pairs of a serialized LayerParameter "
             "and its arrays (float32, C order). Raises InputError for other bytes.");
  module.def(
      "readable_net",
      [](const nb::bytes& net) {
        return bytes_from(proto::readable_net(std::string(bytes_of(net))));
      },
      "net"_a,
      "Returns a serialized NetParameter without the fields of layers that do not parse, because "
      "forks give the same numbers to different fields. Raises InputError for other bytes.");
  module.def(
      "schema", [] { return bytes_from(proto::schema_bytes()); },
      "Returns the schema of Caffe's files as a serialized google.protobuf.FileDescriptorProto, "
      "package revisit.caffe.");
}

void bind_weights(nb::module_& module) {
  nb::class_<SharedWeightsFile>(module, "WeightsFile",
                                "A .caffemodel or HDF5 weights file, read layer by layer.")
      .def(
          "__init__",
          [](SharedWeightsFile* self, const fs::path& file, const std::optional<Limits>& limits) {
            new (self) SharedWeightsFile(
                without_lock([&] { return WeightsFile::open(file, limits.value_or(Limits())); }));
          },
          "file"_a, nb::kw_only(), "limits"_a = nb::none(),
          "Reads only names and offsets. Raises InputError with the byte offset of a defect.")
      .def_static(
          "from_bytes",
          [](const nb::bytes& content, const std::string& name,
             const std::optional<Limits>& limits) {
            const std::string_view bytes = bytes_of(content);
            auto file = without_lock([&] {
              return WeightsFile::open(FileCursor(bytes, name), limits.value_or(Limits()));
            });
            return std::make_unique<SharedWeightsFile>(std::move(file), content);
          },
          "content"_a, "name"_a = "<weights>", nb::kw_only(), "limits"_a = nb::none(),
          "Reads a file in memory; `name` replaces the path in messages.")
      .def_prop_ro("layers", &SharedWeightsFile::layers,
                   "Name and number of arrays of each layer, in file order. Names may repeat.")
      .def("read", &SharedWeightsFile::read, "index"_a,
           "Reads the arrays of layers[index]; None for one stored under another layer. Raises "
           "IndexError, InputError.");
  module.def(
      "read_binaryproto",
      [](const fs::path& file, const std::optional<Limits>& limits) {
        return *array_from(  // never absent
            without_lock([&] { return proto::read_binaryproto(file, limits.value_or(Limits())); }));
      },
      "file"_a, nb::kw_only(), "limits"_a = nb::none(),
      "Reads the array of a .binaryproto, e.g. the mean image of a training set, float32. Raises "
      "InputError.");
}

}  // namespace

void bind_proto(nb::module_& module) {
  bind_record<Limits>(
      module, "Limits",
      "Size limits for files. Files beyond them are rejected, so that a corrupted file cannot "
      "exhaust memory.",
      [](const Limits&) {}, Field{"text_bytes", &Limits::text_bytes, "Size of a prototxt [bytes]."},
      Field{"weight_bytes", &Limits::weight_bytes,
            "Size of a weights file, and of weights in memory [bytes]."},
      Field{"layers", &Limits::layers, "Number of layers."});
  bind_net_file(module);
  bind_graph(module);
  bind_weights(module);
}

}  // namespace revisit::python
