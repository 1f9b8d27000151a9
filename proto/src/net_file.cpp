#include "revisit/proto/net_file.h"

#include <google/protobuf/descriptor.pb.h>
#include <google/protobuf/text_format.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <iterator>
#include <map>
#include <optional>

#include "downloads.h"
#include "net_text.h"
#include "read_binary.h"
#include "revisit/base/files.h"
#include "revisit/base/text.h"
#include "revisit/proto/weights_file.h"
#include "upgrade.h"

namespace revisit::proto {
namespace {

namespace fs = std::filesystem;

// A message takes up to 700 bytes in memory but only two in text; real layers have about five.
constexpr int64_t kMessagesPerLayer = 16;

std::string read_text(const fs::path& file, const Limits& limits) {
  return read_head(file, static_cast<size_t>(limits.text_bytes) + 1);
}

void check_is_text(const std::string& text, const std::string& name, const Limits& limits) {
  const std::string_view head = std::string_view(text).substr(0, 4096);
  if (const std::string wrong = wrong_download(head); !wrong.empty())
    throw InputError(name, ": ", wrong, " (expected a prototxt)");
  const char* found = nullptr;
  if (text.empty())
    found = "is empty";
  else if (head.starts_with("\x89HDF"))
    found = "looks like an HDF5 weights file";
  else if (std::ranges::any_of(head, [](unsigned char c) {
             return c < ' ' && (c == '\0' || !std::strchr("\t\n\v\f\r", c));
           }))
    found = "looks like a binary caffemodel";
  if (found) throw InputError(name, ": ", found, ", expected a prototxt (text)");
  if (head.starts_with("\xEF\xBB\xBF"))
    throw InputError(name, ":1:1: starts with a byte order mark; save it as UTF-8 without one");
  if (static_cast<int64_t>(text.size()) > limits.text_bytes)
    throw InputError(name, ": is larger than ", limits.text_bytes >> 20,
                     " MB, the limit for a network description (raise the limit of text)");
  const auto opens = [](char c) { return c == '{' || c == '<'; };
  if (std::ranges::count_if(text, opens) > limits.layers * kMessagesPerLayer)
    throw InputError(name, ": has more than ", limits.layers * kMessagesPerLayer, " pairs of ",
                     "braces, ", kMessagesPerLayer, " for each of at most ", limits.layers,
                     " layers (raise the limit of layers)");
}

void check_layers(const caffe::NetParameter& net, const std::string& name, const Limits& limits) {
  const int64_t layers = int64_t{net.layer_size()} + net.layers_size();
  if (layers <= limits.layers) return;
  throw InputError(name, ": has ", layers, " layers, more than the limit of ", limits.layers,
                   " (raise the limit of layers)");
}

/// `layer` is an index in `net`, or -1 for a part outside layers.
NetFile::Unread format_unread(const UnreadPart& part, const std::string& name, bool allow_unknown,
                              const caffe::NetParameter& net, int layer) {
  using enum UnreadPart::Effect;
  std::string start = message_start(name, part.position);
  if (layer >= 0 && net.layer(layer).has_name())
    start += str("layer '", net.layer(layer).name(), "'",
                 net.layer(layer).has_type() ? str(" (", net.layer(layer).type(), "): ") : ": ");
  start += part.reason;
  const bool without_effect =
      part.effect == kNone ||
      (part.effect == kOnLoss && (layer < 0 || !is_supported_loss(net.layer(layer).type())));
  if (without_effect)
    return {layer, false, InputError(start, "; it has no effect on results and is ignored")};
  if (part.effect == kOnPrecision)
    return {layer, false, InputError(start, "; the layer is computed in float32")};
  const bool has_hint = start.ends_with("?)") || start.ends_with("it names)");
  if (has_hint || !part.reason.starts_with("unknown field"))
    return {layer, true, InputError(start)};  // likely a misspelling
  if (part.effect == kOutside && allow_unknown)
    return {layer, false, InputError(start, "; it is ignored")};
  if (part.effect == kOutside)
    return {layer, true, InputError(start, "; allow unknown ignores it")};
  return {layer, true,
          InputError(start, "; it may change results, so no option ignores it; if it does not, ",
                     "remove it from the file")};
}

void report_unread(const UnreadPart& part, int layer, const std::string& name,
                   const NetReadOptions& options, NetFile& file) {
  NetFile::Unread unread = format_unread(part, name, options.allow_unknown_fields, file.net, layer);
  if (layer >= 0 && options.keep_unread)
    file.unread.push_back(std::move(unread));
  else if (unread.is_error)
    throw InputError(unread.what);
  else if (constexpr size_t kMaxWarnings = 100; file.warnings.size() < kMaxWarnings)
    file.warnings.emplace_back(unread.what.what());
}

/// `text` is null for a binary file.
NetFile finish(NetFile file, std::vector<UnreadPart> unread, const std::string* text,
               const std::string& name, const NetReadOptions& options) {
  for (const UnreadPart& part : unread)
    if (!part.in_layer) report_unread(part, -1, name, options, file);
  check_layers(file.net, name, options.limits);
  const bool has_layers = file.net.layer_size() + file.net.layers_size() > 0;
  std::vector<std::string> notes;
  std::map<std::string, std::vector<TextPosition>> located;  // by field
  const auto position = [&](const std::string& field, int index) {
    if (!text || index < 0) return TextPosition();
    if (!located.contains(field)) located[field] = locate(*text, field);
    const auto i = static_cast<size_t>(index);
    return i < located[field].size() ? located[field][i] : TextPosition();
  };
  const Blame blame = [&](google::protobuf::Message& layer, std::string reason, int index) {
    if (!text)
      throw InputError(reason);  // no marks: unknown fields of a binary file may look like them
    mark(layer, unread.size());
    unread.push_back(
        {position("layers", index), std::move(reason), UnreadPart::Effect::kUnknown, true});
  };
  try {
    upgrade(file.net, options.keep_training ? ShapelessInputs::kDropped : ShapelessInputs::kKept,
            options.keep_training || options.allow_unknown_fields ? AmbiguousCrops::kStartAtZero
                                                                  : AmbiguousCrops::kErrors,
            blame, notes);
    if (!options.keep_training) {
      keep_inference(file, options, blame, notes);
      replace_python_layers(file.net, options.keep_python, notes);
      widen_inputs(file.net, notes);
    }
  } catch (const UpgradeError& error) {
    throw InputError(message_start(name, position(error.field, error.index)) + error.what());
  } catch (const InputError& error) {
    throw InputError(name, ": ", error);
  }
  for (const std::string& note : notes) file.warnings.push_back(str(name, ": ", note));
  if (file.net.layer_size() == 0)
    throw InputError(
        name, has_layers ? ": has no layers for inference (TEST phase)" : ": describes no layers");
  for (int i = 0; text && i < file.net.layer_size(); ++i)
    for (const size_t part : take_marks(*file.net.mutable_layer(i)))
      report_unread(unread[part], i, name, options, file);
  return file;
}

void check_writable(const fs::path& file, const caffe::NetParameter& net, bool as_binary) {
  if (!net.IsInitialized())
    throw Error(file.string(), ": cannot write a net without ", net.InitializationErrorString());
  const size_t size = as_binary ? net.ByteSizeLong() : 0;
  if (size > static_cast<size_t>(std::numeric_limits<int32_t>::max()))
    throw Error(file.string(), ": the net takes ", size, " bytes (protobuf's limit is 2^31-1)");
}

/// Fields of `state` override those of the text, as in Caffe.
NetFile finish_text(NetFile file, const std::string& text, const std::string& name,
                    const NetReadOptions& options, const caffe::NetState* state) {
  check_is_text(text, name, options.limits);
  ParsedText parsed = parse_net_text(text, name);
  file.net = std::move(parsed.net);
  if (state) file.net.mutable_state()->MergeFrom(*state);
  return finish(std::move(file), std::move(parsed.unread), &text, name, options);
}

/// Unique names of the nets of a solver that have a TEST phase.
std::vector<std::string> named_nets(const caffe::SolverParameter& solver) {
  std::vector<std::string> names(solver.test_net().begin(), solver.test_net().end());
  if (solver.has_net()) names.push_back(solver.net());
  if (names.empty() && solver.has_train_net()) names.push_back(solver.train_net());
  std::sort(names.begin(), names.end());
  names.erase(std::unique(names.begin(), names.end()), names.end());
  return names;
}

fs::path find_net(const std::string& name, const fs::path& solver) {
  const fs::path beside = solver.parent_path() / name;  // `name` itself if absolute
  for (const fs::path& candidate : {beside, fs::path(name)}) {
    std::error_code ignored;
    if (fs::is_regular_file(candidate, ignored)) return candidate;
  }
  throw InputError(solver.string(), ": is a solver file; the net it names, '", name,
                   "', is neither in its folder nor in the working folder; give the net itself");
}

struct SolverNet {
  fs::path file;          // exists
  caffe::NetState state;  // stages and level for testing the net
};

/// Returns the single net that a solver file names, or nullopt if the text is not a solver file.
/// Relative paths start at the solver's folder, else at the working folder (Caffe's rule). Throws
/// InputError if it names several nets, embeds one, or the net does not exist.
std::optional<SolverNet> net_of_solver(const std::string& text, const fs::path& path) {
  caffe::SolverParameter solver;
  google::protobuf::TextFormat::Parser parser;
  Silence silence;
  parser.RecordErrorsTo(&silence);
  parser.AllowPartialMessage(true);
  parser.SetRecursionLimit(kMaxNesting);
  if (!parser.ParseFromString(text, &solver)) return std::nullopt;
  const bool has_net_inside =
      solver.has_net_param() || solver.has_train_net_param() || solver.test_net_param_size() > 0;
  const std::vector<std::string> names = named_nets(solver);
  if (names.empty() && !has_net_inside) return std::nullopt;

  const auto fail = [&](const auto&... reason) {
    throw InputError(path.string(), ": is a solver file ", reason...);
  };
  if (has_net_inside) fail("with an embedded net; move the net to its own prototxt and give that");
  if (names.size() > 1)
    fail("that names several nets: '", joined(names, "', '"), "'; give one of them");
  if (solver.test_state_size() > 1)
    fail("that tests its net in several states; give the net itself, '", names[0], "'");
  SolverNet result{find_net(names[0], path), {}};
  if (solver.test_state_size() == 1) result.state = solver.test_state(0);
  return result;
}

}  // namespace

NetFile parse_net(const std::string& text, const std::string& name, const NetReadOptions& options) {
  return finish_text({}, text, name, options, nullptr);
}

NetFile read_net(const fs::path& prototxt, const NetReadOptions& options) {
  const std::string text = read_text(prototxt, options.limits);
  check_is_text(text, prototxt.string(), options.limits);
  const std::optional<SolverNet> solver = net_of_solver(text, prototxt);
  if (!solver) return parse_net(text, prototxt.string(), options);

  const std::string name = solver->file.string();
  const std::string net_text = read_text(solver->file, options.limits);
  NetFile file;
  file.warnings.push_back(
      str(prototxt.string(), ": is a solver file; read the net it names, ", name));
  return finish_text(std::move(file), net_text, name, options, &solver->state);
}

NetFile read_net_binary(const fs::path& file, const Limits& limits) {
  // The indexing reader checks the structure first, with better messages and little I/O.
  WeightsFile::open(file, limits);
  std::ifstream in(file, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(in), {}};
  NetFile result;
  std::vector<std::string> skipped;
  if (!parse_binary(bytes, result.net, skipped))
    throw InputError(file.string(), ": protobuf cannot parse it as a caffemodel");
  for (const std::string& what : skipped) result.warnings.push_back(str(file.string(), ": ", what));
  if (!result.net.IsInitialized())
    throw InputError(file.string(), ": missing required field ",
                     result.net.InitializationErrorString());
  return finish(std::move(result), {}, nullptr, file.string(),
                {.keep_training = true, .limits = limits});
}

std::string net_text(const caffe::NetParameter& net) {
  std::string text;
  if (!google::protobuf::TextFormat::PrintToString(net, &text))
    throw Error("protobuf cannot print this net as text");
  return text;
}

std::string net_bytes(const caffe::NetParameter& net) {
  check_writable("<caffemodel>", net, true);
  return net.SerializeAsString();
}

std::string schema_bytes() {
  google::protobuf::FileDescriptorProto schema;
  caffe::NetParameter::descriptor()->file()->CopyTo(&schema);
  return schema.SerializeAsString();
}

void write_net_text(const fs::path& file, const caffe::NetParameter& net) {
  check_writable(file, net, false);
  const std::string text = net_text(net);
  write_atomically(file, [&](std::ostream& out) { out << text; });
}

void write_net_binary(const fs::path& file, const caffe::NetParameter& net) {
  check_writable(file, net, true);
  write_atomically(file, [&](std::ostream& out) {
    if (!net.SerializeToOstream(&out)) out.setstate(std::ios::failbit);
  });
}

}  // namespace revisit::proto
