#include <iostream>

#include "cli/net_options.h"
#include "cli/terminal.h"
#include "net_commands.h"
#include "revisit/base/files.h"
#include "revisit/engine/net.h"
#include "revisit/proto/net_file.h"
#include "revisit/proto/weights_file.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

enum class Kind { kText, kBinary, kHdf5 };

/// Recognizes binary protobuf by its tags, which are control characters. Throws InputError.
Kind kind_of(const fs::path& file) {
  const std::string head = read_head(file, 4096);
  if (head.starts_with("\x89HDF")) return Kind::kHdf5;
  if (head.starts_with("\x93NUMPY"))
    throw InputError(file.string() +
                     ": expected a prototxt or weights of Caffe, found a NumPy array");
  for (const char c : head) {
    const auto byte = static_cast<unsigned char>(c);
    if (byte < ' ' && !(byte >= '\t' && byte <= '\r')) return Kind::kBinary;
  }
  return Kind::kText;
}

/// HDF5 holds only names and weights, and Caffe needs nothing else.
proto::NetFile read_hdf5(const fs::path& path, const proto::Limits& limits) {
  proto::NetFile result;
  const auto file = proto::WeightsFile::open(path, limits);
  for (size_t i = 0; i < file->layers().size(); ++i) {
    caffe::LayerParameter& layer = *result.net.add_layer();
    layer.set_name(file->layers()[i].name);
    for (const proto::Blob& blob : file->read(i)) {
      if (blob.absent)
        throw InputError(path.string(), ": layer '", layer.name(),
                         "' shares an array that the file stores under another layer, which a "
                         "caffemodel does not support");
      caffe::BlobProto& out = *layer.add_blobs();
      out.mutable_shape()->mutable_dim()->Add(blob.shape.begin(), blob.shape.end());
      out.mutable_data()->Add(blob.data.begin(), blob.data.end());
    }
  }
  return result;
}

struct UpgradeOptions {
  fs::path in;
  std::optional<fs::path> out;
  std::vector<std::string> input_shapes;
  bool force = false, inference = false;
  proto::NetReadOptions read;
  LimitOptions limits;

  void declare(Options& options) {
    options.argument("IN", &in);
    options.argument("OUT", &out).optional();
    options.flag("force", "replacement of an existing OUT", &force);
    options.flag("inference", "only the layers of inference, for a prototxt", &inference);
    declare_input_shape(options, &input_shapes);
    limits.declare(options);
  }
};

int upgrade(UpgradeOptions& o) {
  o.read.limits = o.limits.limits();
  o.read.allow_unknown_fields = o.limits.allows("unknown");
  o.read.keep_training = !o.inference;
  o.read.types_with_weights = engine::types_with_weights();

  const Kind kind = kind_of(o.in);
  if (!o.out && kind != Kind::kText)
    throw UsageError(o.in.string(), ": missing argument OUT, which weights need");
  if (o.inference && kind != Kind::kText)
    throw UsageError("--inference: expected a prototxt, found weights in ", o.in.string());
  if (!o.inference && !o.input_shapes.empty())
    throw UsageError("--input-shape: needs --inference, which turns data layers into inputs");
  const bool replaces = o.out && check_target(*o.out) && fs::exists(*o.out);
  if (replaces && !o.force)
    throw UsageError(o.out->string(), ": the file exists; give --force to replace it");

  proto::NetFile file = kind == Kind::kText     ? proto::read_net(o.in, o.read)
                        : kind == Kind::kBinary ? proto::read_net_binary(o.in, o.read.limits)
                                                : read_hdf5(o.in, o.read.limits);
  for (const std::string& warning : file.warnings) warn(warning);
  set_input_shapes(o.in, o.input_shapes, &file.net);
  if (kind != Kind::kText) {
    proto::write_net_binary(*o.out, file.net);
  } else if (o.out) {
    proto::write_net_text(*o.out, file.net);
  } else {
    std::cout << proto::net_text(file.net);
  }
  return kOk;
}

}  // namespace

Command net_upgrade_command() {
  return {"upgrade", "current format of an old prototxt and caffemodel",
          "Writes a prototxt, a caffemodel or an HDF5 weights file of any age in the current "
          "format of Caffe (V2): a prototxt as text, weights as a binary caffemodel. The content "
          "of IN decides its kind. Everything is kept; --inference removes training layers. "
          "Without OUT, text goes to standard output.",
          "  revisit net upgrade old.prototxt new.prototxt\n"
          "  revisit net upgrade --inference train_val.prototxt deploy.prototxt\n"
          "  revisit net upgrade --inference --input-shape 1,3,224,224 train_val.prototxt\n"
          "  revisit net upgrade old.caffemodel new.caffemodel\n"
          "  revisit net upgrade weights.caffemodel.h5 weights.caffemodel\n",
          with_options<UpgradeOptions>(upgrade)};
}

}  // namespace revisit::cli
