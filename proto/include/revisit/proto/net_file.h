#pragma once

#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "caffe_schema.pb.h"
#include "revisit/base/error.h"
#include "revisit/proto/limits.h"

namespace revisit::proto {

struct NetReadOptions {
  /// Unknown fields beside the parameters of layers are errors; true makes them warnings. Those
  /// that are known to have no effect are warnings in any case; those that may have one, and those
  /// that seem to mean a known field, are errors.
  bool allow_unknown_fields = false;
  /// What does not parse in a layer is left to the caller, who may not need the layer.
  bool keep_unread = false;
  /// Keep what only training needs (layers of other phases, data layers, losses): the file as it
  /// is, merely upgraded. Otherwise the net is the one inference runs.
  bool keep_training = false;
  /// Layers of the type Python stay what they are, for a caller who runs them.
  bool keep_python = false;
  /// Layer types with weights (engine::types_with_weights()): a loss takes what comes out of one as
  /// the prediction, not as a label. Without them a training net may keep its labels.
  std::set<std::string> types_with_weights = {};
  Limits limits;
};

/// A network description in the current form (V2): only `layer`, every input an Input layer, no
/// `input*` fields and no V1 `layers`.
struct NetFile {
  /// A part of the text of a layer that `net` does not have, because it does not parse.
  struct Unread {
    int layer;        // its index in `net`
    bool is_error;    // else a warning
    InputError what;  // for whoever needs the layer
  };
  caffe::NetParameter net;
  std::vector<Unread> unread;                   // with NetReadOptions::keep_unread
  std::map<std::string, std::string> left_out;  // layers that `net` lacks: what became of them
  std::vector<std::string> warnings;  // what the upgrade did, and what became of training layers
};

/// Reads a .prototxt of any generation, upgrades it in Caffe's order (docs/LAYERS.md point 7) and
/// takes out what the TEST phase runs (inference_net.h). A solver file is followed to the one net
/// it names, looked for beside the solver, then in the working folder. Throws InputError,
/// `path:line:column: reason`, for text that does not parse or upgrade, has no layers, or exceeds
/// a limit.
NetFile read_net(const std::filesystem::path& prototxt, const NetReadOptions& options = {});

/// The same for text in memory, which cannot be a solver; `name` stands for the path in messages.
NetFile parse_net(const std::string& text, const std::string& name,
                  const NetReadOptions& options = {});

/// Reads a binary caffemodel whole, weights included, and upgrades it; nothing is left out.
/// Throws InputError for a file that is not one, or exceeds a limit.
NetFile read_net_binary(const std::filesystem::path& file, const Limits& limits = {});
/// The same of its content; `name` stands for the path in messages.
NetFile parse_net_binary(std::string_view content, const std::string& name,
                         const Limits& limits = {});

/// The net as prototxt text.
std::string net_text(const caffe::NetParameter& net);
/// The net as a binary file has it. Throws Error for more than protobuf's 2^31-1 bytes, and for a
/// net without what the format requires.
std::string net_bytes(const caffe::NetParameter& net);
/// The schema of these files, for other programs: a serialized google.protobuf.FileDescriptorProto.
std::string schema_bytes();

/// Writes the net as prototxt text, or as binary (with weights: a caffemodel). The file appears
/// whole or not at all. Throws Error when it cannot be written.
void write_net_text(const std::filesystem::path& file, const caffe::NetParameter& net);
void write_net_binary(const std::filesystem::path& file, const caffe::NetParameter& net);

}  // namespace revisit::proto
