#pragma once

#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "caffe_schema.pb.h"
#include "revisit/base/error.h"
#include "revisit/proto/limits.h"

namespace revisit::proto {

/// What read_net() keeps, and the state whose layers it selects.
struct NetReadOptions {
  /// Downgrades errors for unknown fields outside the parameters of layers to warnings. Fields
  /// known to have no effect are always warnings. Fields that may have one, and likely
  /// misspellings, are always errors. A Crop without crop_param, for which forks compute an offset,
  /// starts at 0 instead of being an error.
  bool allow_unknown_fields = false;
  /// Returns parse errors inside layers in NetFile::unread instead of throwing, because the caller
  /// may not need the layer.
  bool keep_unread = false;
  /// Keeps training-only layers: other phases, data layers, losses. The net is then only upgraded,
  /// not reduced to the inference net.
  bool keep_training = false;
  /// Keeps Python layers for a caller that runs them. Else those without bottoms become inputs.
  bool keep_python = false;
  /// Phase TRAIN instead of TEST, level, and stages in addition to those of the file: select layers
  /// by their include and exclude rules.
  bool train = false;
  int level = 0;                         ///< of the state
  std::vector<std::string> stages = {};  ///< besides those of the file
  /// Layer types with weights (engine::types_with_weights()). A loss input that depends on one is
  /// the prediction, not a label. If empty, a training net may keep its labels.
  std::set<std::string> types_with_weights = {};
  Limits limits;  ///< sizes beyond them are errors
};

/// A network description in the current form (V2): `layer` entries only, without V1 `layers`; every
/// input is an Input layer, without `input*` fields.
struct NetFile {
  /// Part of a layer's text that does not parse and is missing in `net`.
  struct Unread {
    int layer;        ///< index in `net`
    bool is_error;    ///< else a warning
    InputError what;  ///< to be thrown if the layer is needed
  };
  caffe::NetParameter net;                     ///< upgraded, with the selected layers
  std::vector<Unread> unread;                  ///< with NetReadOptions::keep_unread
  std::map<std::string, std::string> skipped;  ///< fate of skipped layers, by name
  std::map<std::string, std::string> dropped;  ///< blob -> layer of another state that writes it
  std::vector<std::string> warnings;           ///< upgrades and changes to training layers
};

/// Reads a .prototxt of any generation, upgrades it in Caffe's order (docs/reference/LAYERS.md
/// point 7) and extracts the layers of the state (inference_net.cpp). For a solver file, reads the
/// single net that it names, relative to the solver's folder, else to the working folder. Throws
/// InputError, `path:line:column: reason`, if the text does not parse or upgrade, has no layers, or
/// exceeds a limit.
NetFile read_net(const std::filesystem::path& prototxt, const NetReadOptions& options = {});

/// Parses text in memory like read_net(), except solver files; `name` is the path in messages.
NetFile parse_net(const std::string& text, const std::string& name,
                  const NetReadOptions& options = {});

/// Reads a binary caffemodel completely, with weights, and upgrades it; keeps training layers.
/// Throws InputError if the file is not a caffemodel or exceeds a limit.
NetFile read_net_binary(const std::filesystem::path& file, const Limits& limits = {});

/// Throws Error if protobuf cannot print the net.
std::string net_text(const caffe::NetParameter& net);
/// Throws Error if the net exceeds protobuf's 2^31-1 bytes or lacks a required field.
std::string net_bytes(const caffe::NetParameter& net);
/// Returns a serialized NetParameter without the fields of layers that do not parse, because forks
/// give the same numbers to different fields. Throws InputError for other bytes.
std::string readable_net(const std::string& bytes);
/// Serialized google.protobuf.FileDescriptorProto of caffe_schema.proto.
std::string schema_bytes();

/// Writes the file atomically. Throws Error if it cannot be written.
void write_net_text(const std::filesystem::path& file, const caffe::NetParameter& net);
/// As write_net_text(), with weights.
void write_net_binary(const std::filesystem::path& file, const caffe::NetParameter& net);

/// Fork of Caffe that defines an unsupported layer type, or "". Accepts the type name of any
/// generation or its parameter field: "PSROI_POOLING", "psroi_pooling_param".
std::string fork_of(std::string_view name);

// Which value a blob name means: the only code that resolves names, in-place layers and blobs that
// share memory in Caffe.

using ValueId = int;  ///< index into Graph::values

/// A tensor that is written once (SSA): an in-place ReLU creates a new value of the same blob.
struct Value {
  std::string blob;     ///< name in the file
  ValueId memory = -1;  ///< first value in the memory where Caffe stores this one
};

/// A layer of the file, or an inserted Split with two inputs: it shows the first, which an in-place
/// layer wrote, in the shape of the second, which shares its memory.
struct Node {
  std::string name, type;                ///< of the layer; "Split" if inserted
  int index = -1;                        ///< position of the layer in the file; -1: inserted
  std::vector<ValueId> inputs, outputs;  ///< in the order of bottoms and tops
  bool in_place = false;  ///< in the file: an output has the blob name of the input at its position
  /// Invalid names, which are errors only if the layer is needed:
  std::string dangling = {};     ///< an input, with id -1, that no earlier layer writes
  std::string overwritten = {};  ///< an output that another layer has written
};

/// Nodes in execution order.
struct Graph {
  std::string name;                                      ///< of the net
  std::vector<Node> nodes;                               ///< inputs are nodes of type Input
  std::vector<Value> values;                             ///< by ValueId
  std::vector<std::pair<std::string, ValueId>> outputs;  ///< names; blobs without consumers if full
  std::map<std::string, std::string> dropped = {};       ///< NetFile::dropped, for messages
  std::vector<std::string> warnings = {};                ///< about a graft
};

/// Returns whether Caffe stores the tops of a layer in the memory of its first bottom. All of them
/// then show the result of a later in-place layer on any of them.
bool shares_memory(const caffe::LayerParameter& layer);

/// Resolves the blob names of a net from read_net(), for layers of any type.
Graph resolve(const caffe::NetParameter& net);

/// Keeps what the outputs of the layer `end` need, or the net's outputs if `end` is empty. If no
/// layer has that name, `end` is a blob, and its last value counts. `graft`, if not empty, is
/// appended: a copy of this layer, named "end+graft", after the in-place layers, BatchNorm, Scale
/// and ReLU of `end`. Throws UsageError for unknown names, with the nearest, for names of several
/// layers, and for invalid grafts; InputError for a needed layer that reads an unwritten blob or
/// writes a blob again.
Graph prune(const Graph& graph, const std::string& end, const std::string& graft);

/// Returns the name of output `port` of a layer: "slice", "slice.1", "slice.2", ...
std::string port_name(const std::string& layer, size_t port);

}  // namespace revisit::proto
