#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "caffe.pb.h"
#include "revisit/proto/error.h"

namespace revisit::proto {

struct NetReadOptions {
  /// Unknown fields are errors with the nearest known name; true makes them warnings.
  bool allow_unknown_fields = false;
};

/// A network description in the current form (V2): only `layer`, every input an Input layer, no
/// `input*` fields and no V1 `layers`. `warnings` says what a person should know about the upgrade.
struct NetFile {
  caffe::NetParameter net;
  std::vector<std::string> warnings;
};

/// Reads a .prototxt of any generation and upgrades it in Caffe's order (SEMANTICS section 7).
/// Throws InputError, `path:line:column: reason`, for text that does not parse or upgrade, that
/// describes no layers, or is larger than 16 MB.
NetFile read_net(const std::filesystem::path& prototxt, const NetReadOptions& options = {});

/// The same for text in memory; `name` stands for the path in messages.
NetFile parse_net(const std::string& text, const std::string& name,
                  const NetReadOptions& options = {});

/// Writes the net as prototxt text, or as binary (with weights: a caffemodel). The file appears
/// whole or not at all. Throws Error when it cannot be written.
void write_net_text(const std::filesystem::path& file, const caffe::NetParameter& net);
void write_net_binary(const std::filesystem::path& file, const caffe::NetParameter& net);

}  // namespace revisit::proto
