#include "net_text.h"

#include <google/protobuf/io/tokenizer.h>
#include <google/protobuf/text_format.h>

#include <algorithm>
#include <charconv>
#include <optional>
#include <string_view>

#include "revisit/base/error.h"
#include "revisit/proto/limits.h"
#include "silence.h"

namespace revisit::proto {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::EnumDescriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::TextFormat;

std::vector<std::string> field_names(const Descriptor& message) {
  std::vector<std::string> names;
  for (int i = 0; i < message.field_count(); ++i) names.push_back(message.field(i)->name());
  return names;
}

/// The values of every enum that a field of this name can have, in any message.
std::vector<std::string> enum_values(const std::string& field_name) {
  std::vector<std::string> names;
  const auto* file = caffe::NetParameter::descriptor()->file();
  for (int i = 0; i < file->message_type_count(); ++i) {
    const FieldDescriptor* field = file->message_type(i)->FindFieldByName(field_name);
    const EnumDescriptor* type = field ? field->enum_type() : nullptr;
    for (int v = 0; type && v < type->value_count(); ++v) names.push_back(type->value(v)->name());
  }
  return names;
}

/// What stands between `before` and `after`, or nothing.
std::optional<std::string> between(const std::string& text, std::string_view before,
                                   std::string_view after) {
  const size_t start = text.find(before);
  if (start == std::string::npos) return std::nullopt;
  const size_t begin = start + before.size();
  const size_t end = text.find(after, begin);
  if (end == std::string::npos) return std::nullopt;
  return text.substr(begin, end - begin);
}

/// The byte in `text` that protobuf's tokenizer means; it expands tabs to 8 columns. Both from 0.
size_t byte_offset(const std::string& text, int line, int column) {
  size_t begin = 0;
  for (int i = 0; i < line && begin < text.size(); ++i)
    begin = std::min(text.find('\n', begin), text.size() - 1) + 1;
  size_t offset = begin;
  for (int reached = 0; reached < column && offset < text.size(); ++offset)
    reached = text[offset] == '\t' ? (reached / 8 + 1) * 8 : reached + 1;
  return offset;
}

TextPosition position_of(const std::string& text, size_t offset) {
  const auto end = text.begin() + static_cast<std::ptrdiff_t>(offset);
  const size_t line_begin = offset == 0 ? 0 : text.rfind('\n', offset - 1) + 1;  // npos + 1 is 0
  return {1 + static_cast<int>(std::count(text.begin(), end, '\n')),
          1 + static_cast<int>(offset - line_begin)};
}

/// Takes protobuf's complaints and says them our way: `name:line:column: reason`, with hints.
class Complaints final : public google::protobuf::io::ErrorCollector {
 public:
  Complaints(const std::string& text, const std::string& name, std::vector<std::string>& warnings)
      : text_(text), name_(name), warnings_(warnings) {}

  void AddError(int line, google::protobuf::io::ColumnNumber column,
                const std::string& message) override {
    if (first_error.empty()) first_error = tell(line, column, message, "");
  }
  void AddWarning(int line, google::protobuf::io::ColumnNumber column,
                  const std::string& message) override {
    constexpr size_t kMostWarnings = 100;
    if (warnings_.size() < kMostWarnings)
      warnings_.push_back(tell(line, column, message, "; it is ignored"));
  }

  std::string first_error;

 private:
  std::string tell(int line, int column, const std::string& message,
                   const char* consequence) const {
    if (line < 0) return message_start(name_, {}) + message;
    size_t offset = byte_offset(text_, line, column);
    std::string reason = message;
    if (const auto name = between(message, "has no field named \"", "\".")) {
      offset = begin_of(*name, offset);
      const std::string package = caffe::NetParameter::descriptor()->file()->package();
      const std::string before = str("Message type \"", package, ".");
      reason = unknown_field(*name, between(message, before, "\"").value_or(""));
    } else if (const auto value = between(message, "Unknown enumeration value of \"", "\"")) {
      offset = begin_of(*value, offset);
      reason = unknown_enum(*value, between(message, "for field \"", "\"").value_or(""));
    } else if (const auto again = between(message, "Non-repeated field \"", "\" is specified")) {
      offset = begin_of(*again, offset);
    } else if (message.ends_with("got: ")) {
      reason += "the end of the text";
    }
    return message_start(name_, position_of(text_, offset)) + reason + consequence;
  }

  /// protobuf complains of a name when it is already behind it.
  size_t begin_of(const std::string& name, size_t offset) const {
    if (offset < name.size()) return offset;
    const size_t begin = text_.rfind(name, offset - name.size());
    return begin == std::string::npos ? offset : begin;
  }

  static std::string unknown_field(const std::string& field, const std::string& message) {
    std::string hint;
    const Descriptor* type =
        caffe::NetParameter::descriptor()->file()->FindMessageTypeByName(message);
    if (type) hint = did_you_mean(field, field_names(*type));
    const Descriptor* net = caffe::NetParameter::descriptor();
    if (type == net && caffe::SolverParameter::descriptor()->FindFieldByName(field))
      hint = " (is this a solver file? give the net it names)";
    return str("unknown field '", field, "' in ", message, hint);
  }

  static std::string unknown_enum(const std::string& value, const std::string& field) {
    std::string upper = value;
    std::ranges::transform(upper, upper.begin(), [](char c) {
      return c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
    });
    return str("unknown value '", value, "' for ", field, did_you_mean(upper, enum_values(field)));
  }

  const std::string& text_;
  const std::string& name_;
  std::vector<std::string>& warnings_;
};

/// Parses again, now noting where each field stands: only needed for errors, and large.
void map_text(const std::string& text, TextFormat::ParseInfoTree& tree) {
  TextFormat::Parser parser;
  Silence silence;
  parser.RecordErrorsTo(&silence);
  parser.WriteLocationsTo(&tree);
  parser.AllowPartialMessage(true);
  parser.AllowUnknownField(true);
  parser.SetRecursionLimit(kDeepestNesting);
  caffe::NetParameter unused;
  parser.ParseFromString(text, &unused);
}

TextPosition position_of(const std::string& text, const TextFormat::ParseLocation& location) {
  return location.line < 0 ? TextPosition{}
                           : position_of(text, byte_offset(text, location.line, location.column));
}

/// Where the message stands that a protobuf path such as `layer[3].clip_param.min` lies in.
TextPosition locate_parent(const std::string& text, std::string_view path) {
  TextFormat::ParseInfoTree root;
  map_text(text, root);
  const TextFormat::ParseInfoTree* tree = &root;
  const Descriptor* message = caffe::NetParameter::descriptor();
  TextPosition position;
  for (size_t dot = path.find('.'); tree && dot != std::string_view::npos; dot = path.find('.')) {
    const std::string_view step = path.substr(0, dot);
    path.remove_prefix(dot + 1);
    const size_t bracket = step.find('[');
    const FieldDescriptor* field = message->FindFieldByName(std::string(step.substr(0, bracket)));
    if (!field) break;
    int index = field->is_repeated() ? 0 : -1;
    if (bracket != std::string_view::npos)
      std::from_chars(step.data() + bracket + 1, step.data() + step.size(), index);
    position = position_of(text, tree->GetLocation(field, index));
    tree = tree->GetTreeForNested(field, index);
    message = field->message_type();
  }
  return position;
}

void check_complete(const caffe::NetParameter& net, const std::string& text,
                    const std::string& name) {
  std::vector<std::string> missing;
  if (net.IsInitialized()) return;
  net.FindInitializationErrors(&missing);
  throw InputError(message_start(name, locate_parent(text, missing.front())),
                   "missing required field ", missing.front());
}

}  // namespace

std::string message_start(const std::string& name, TextPosition position) {
  return position.line == 0 ? name + ": "
                            : str(name, ":", position.line, ":", position.column, ": ");
}

caffe::NetParameter parse_net_text(const std::string& text, const std::string& name,
                                   const NetReadOptions& options,
                                   std::vector<std::string>& warnings) {
  Complaints complaints(text, name, warnings);
  TextFormat::Parser parser;
  parser.RecordErrorsTo(&complaints);
  parser.AllowUnknownField(options.allow_unknown_fields);
  parser.AllowPartialMessage(true);
  parser.SetRecursionLimit(kDeepestNesting);
  caffe::NetParameter net;
  if (!parser.ParseFromString(text, &net))
    throw InputError(complaints.first_error.empty() ? message_start(name, {}) + "cannot be parsed"
                                                    : complaints.first_error);
  check_complete(net, text, name);
  return net;
}

TextPosition locate(const std::string& text, const std::string& field, int index) {
  TextFormat::ParseInfoTree tree;
  map_text(text, tree);
  const FieldDescriptor* descriptor = caffe::NetParameter::descriptor()->FindFieldByName(field);
  return position_of(text, tree.GetLocation(descriptor, index));
}

}  // namespace revisit::proto
