#include "net_text.h"

#include <google/protobuf/io/tokenizer.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>
#include <google/protobuf/text_format.h>

#include <algorithm>
#include <iterator>
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <utility>

#include "revisit/base/error.h"
#include "revisit/proto/limits.h"
#include "revisit/proto/net_file.h"
#include "text_fields.h"
#include "upgrade.h"

namespace revisit::proto {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::EnumDescriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::TextFormat;

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

std::optional<std::string> between(const std::string& text, std::string_view before,
                                   std::string_view after) {
  const size_t start = text.find(before);
  if (start == std::string::npos) return std::nullopt;
  const size_t begin = start + before.size();
  const size_t end = text.find(after, begin);
  if (end == std::string::npos) return std::nullopt;
  return text.substr(begin, end - begin);
}

/// `line` and `column` are protobuf's, both from 0; its tokenizer expands tabs to 8 columns.
size_t byte_offset(std::string_view text, int line, int column) {
  size_t begin = 0;
  for (int i = 0; i < line && begin < text.size(); ++i)
    begin = std::min(text.find('\n', begin), text.size() - 1) + 1;
  size_t offset = begin;
  for (int reached = 0; reached < column && offset < text.size(); ++offset)
    reached = text[offset] == '\t' ? (reached / 8 + 1) * 8 : reached + 1;
  return offset;
}

class Lines {
 public:
  explicit Lines(std::string_view text) {
    for (size_t at = text.find('\n'); at != std::string_view::npos; at = text.find('\n', at + 1))
      begins_.push_back(at + 1);
  }
  TextPosition position(size_t offset) const {
    const auto next = std::ranges::upper_bound(begins_, offset);
    return {static_cast<int>(next - begins_.begin()),
            1 + static_cast<int>(offset - *std::prev(next))};
  }

 private:
  std::vector<size_t> begins_ = {0};
};

class FirstError final : public google::protobuf::io::ErrorCollector {
 public:
  explicit FirstError(std::string_view part) : part_(part) {}

  void AddError(int line, google::protobuf::io::ColumnNumber column,
                const std::string& message) override {
    if (!reason.empty()) return;
    reason = message;
    if (line < 0) return;
    offset = byte_offset(part_, line, column);
    if (const auto name = between(message, "has no field named \"", "\".")) {
      offset = begin_of(*name);
      const std::string before =
          str("Message type \"", caffe::NetParameter::descriptor()->file()->package(), ".");
      const Descriptor* type = caffe::NetParameter::descriptor()->file()->FindMessageTypeByName(
          between(message, before, "\"").value_or(""));
      if (type) reason = unknown_field(*name, *type, "");
    } else if (const auto value = between(message, "Unknown enumeration value of \"", "\"")) {
      offset = begin_of(*value);
      reason = unknown_enum(*value, between(message, "for field \"", "\"").value_or(""));
      is_of_value = true;
    } else if (message.ends_with("got: ")) {
      reason += "the end of the text";
    }
  }

  std::string reason;
  size_t offset = 0;  // in the part
  bool is_of_value = false;

 private:
  /// Start of a name, because protobuf locates an error after the name.
  size_t begin_of(const std::string& name) const {
    if (offset < name.size()) return offset;
    const size_t begin = part_.rfind(name, offset - name.size());
    return begin == std::string_view::npos ? offset : begin;
  }

  static std::string unknown_enum(const std::string& value, const std::string& field) {
    std::string upper = value;
    std::ranges::transform(upper, upper.begin(), [](char c) {
      return c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
    });
    const std::string fork = field == "type" ? fork_of(value) : "";
    return str(
        "unknown value '", value, "' for ", field,
        fork.empty() ? misspelling_hint(upper, enum_values(field)) : str(" (it is of ", fork, ")"));
  }

  std::string_view part_;
};

bool parses(std::string_view text, google::protobuf::io::ErrorCollector& complaints,
            bool allow_unknown, Message& into) {
  TextFormat::Parser parser;
  parser.RecordErrorsTo(&complaints);
  parser.AllowPartialMessage(true);
  parser.AllowUnknownField(allow_unknown);
  parser.SetRecursionLimit(kMaxNesting);
  google::protobuf::io::ArrayInputStream stream(text.data(), static_cast<int>(text.size()));
  return parser.Parse(&stream, &into);
}

// Marks are unknown fields of a layer's message, because all upgrades preserve those. They use the
// highest field numbers.
constexpr int kMark = FieldDescriptor::kMaxNumber;
constexpr int kTypeMark = kMark - 1;

google::protobuf::UnknownFieldSet& unknown_fields(Message& message) {
  return *message.GetReflection()->MutableUnknownFields(&message);
}

/// Reads a net in parts: if a part does not parse, reads its fields separately.
class PartReader {
 public:
  explicit PartReader(std::string_view text) : text_(text), lines_(text) {}

  /// Returns false if the text has no structure or too many unreadable parts.
  bool read(caffe::NetParameter& net) {
    const auto fields = text_fields(text_, 0, text_.size());
    if (!fields) return false;
    read_fields(*fields, net, "");
    return unread_.size() <= kMost;
  }

  std::vector<UnreadPart> take() { return std::move(unread_); }

 private:
  static constexpr size_t kMost = 10'000;  // nets of forks have a few per layer

  void read_fields(std::span<const TextField> fields, Message& into, std::string_view reached_by) {
    if (fields.empty() || unread_.size() > kMost) return;
    if (fields.size() == 1) {
      read_field(fields[0], into, reached_by);
      return;
    }
    const size_t begin = fields.front().begin, half = fields.size() / 2;
    Silence silence;
    const std::unique_ptr<Message> read(into.New());
    if (parses(text_.substr(begin, fields.back().end - begin), silence, false, *read) &&
        read->IsInitialized() && !sets_again(*read, into)) {
      into.MergeFrom(*read);
      return;
    }
    read_fields(fields.first(half), into, reached_by);
    read_fields(fields.subspan(half), into, reached_by);
  }

  static bool sets_again(const Message& read, const Message& into) {
    std::vector<const FieldDescriptor*> fields;
    read.GetReflection()->ListFields(read, &fields);
    return std::ranges::any_of(fields, [&](const FieldDescriptor* field) {
      return !field->is_repeated() && into.GetReflection()->HasField(into, field);
    });
  }

  void read_field(const TextField& field, Message& into, std::string_view reached_by) {
    const std::string name(field.name);
    const Descriptor& type = *into.GetDescriptor();
    const FieldDescriptor* known = type.FindFieldByName(name);
    if (!known) {
      if (selects_implementation(name)) return;
      const bool is_message = field.opens == '{' || field.opens == '<';
      note_unread(field.begin, unknown_field(name, type, type_of_layer()),
                  effect_of(name, type, reached_by, is_message));
      return;
    }
    const FieldDescriptor* const twin = type.FindFieldByName(name + "_nd");
    const bool has_value = !known->is_repeated() && into.GetReflection()->HasField(into, known);
    if (twin && (has_value || field.opens == '[') && append_to_twin(field, *known, *twin, into))
      return;
    if (has_value) {
      note_unread(field.begin,
                  str("Non-repeated field \"", name, "\" is specified multiple times."));
      return;
    }
    const std::string_view part = text_.substr(field.begin, field.end - field.begin);
    FirstError complaint(part);
    const std::unique_ptr<Message> read(into.New());
    if (parses(part, complaint, false, *read) && (!known->message_type() || read->IsInitialized()))
      into.MergeFrom(*read);
    else if (!read_inside(field, *known, into))
      leave_out_value(field, *known, complaint, reached_by);
  }

  /// Reads a further value, or a list, of a field of PoolingParameter with one value per axis. The
  /// first value is in the field itself, and in `twin` with the others.
  bool append_to_twin(const TextField& field, const FieldDescriptor& known,
                      const FieldDescriptor& twin, Message& into) {
    const std::string name(field.name);
    const std::string_view value = text_.substr(field.value, field.end - field.value);
    Silence silence;
    const std::unique_ptr<Message> read(into.New());
    if (!parses(str(name, "_nd: ", value), silence, false, *read)) return false;
    const auto* reflection = into.GetReflection();
    if (reflection->FieldSize(*read, &twin) == 0) return false;
    if (!reflection->HasField(into, &known))
      reflection->SetUInt32(&into, &known, reflection->GetRepeatedUInt32(*read, &twin, 0));
    else if (reflection->FieldSize(into, &twin) == 0)
      reflection->AddUInt32(&into, &twin, reflection->GetUInt32(into, &known));
    into.MergeFrom(*read);
    return true;
  }

  bool read_inside(const TextField& field, const FieldDescriptor& known, Message& into) {
    if (!known.message_type() || field.opens == '[') return false;
    const auto fields = text_fields(text_, field.value + 1, field.end - 1);
    if (!fields) return false;
    const auto* reflection = into.GetReflection();
    Message& inside = known.is_repeated() ? *reflection->AddMessage(&into, &known)
                                          : *reflection->MutableMessage(&into, &known);
    const bool is_layer = into.GetDescriptor() == caffe::NetParameter::descriptor() &&
                          (known.name() == "layer" || known.name() == "layers");
    if (is_layer) layer_ = &inside;
    read_fields(*fields, inside, known.name());
    for (int i = 0; i < known.message_type()->field_count(); ++i) {
      const FieldDescriptor* part = known.message_type()->field(i);
      if (part->is_required() && !inside.GetReflection()->HasField(inside, part))
        note_unread(field.begin, str("missing required field ", known.name(), ".", part->name()));
    }
    if (is_layer) layer_ = nullptr;
    return true;
  }

  void leave_out_value(const TextField& field, const FieldDescriptor& known,
                       const FirstError& complaint, std::string_view reached_by) {
    if (known.enum_type() && selects_implementation(known.name())) return;
    if (&known == caffe::V1LayerParameter::descriptor()->FindFieldByName("type") && layer_) {
      const std::string type(text_.substr(field.value, field.end - field.value));
      unknown_fields(*layer_).AddLengthDelimited(kTypeMark)->assign(type);
      if (!type_of_v1(type).empty()) return;
    }
    auto effect = UnreadPart::Effect::kUnknown;
    if (known.enum_type())
      effect = effect_of(known.name(), *known.containing_type(), reached_by, false);
    if (effect == UnreadPart::Effect::kOutside) effect = UnreadPart::Effect::kUnknown;
    note_unread(field.begin + complaint.offset, complaint.reason, effect);
  }

  /// The layer's type, if its field precedes the part being read.
  std::string type_of_layer() const {
    const auto* layer = google::protobuf::DynamicCastToGenerated<caffe::LayerParameter>(layer_);
    return layer ? layer->type() : "";
  }

  void note_unread(size_t offset, std::string reason,
                   UnreadPart::Effect effect = UnreadPart::Effect::kUnknown) {
    if (layer_) mark(*layer_, unread_.size());
    unread_.push_back({lines_.position(offset), std::move(reason), effect, layer_ != nullptr});
  }

  std::string_view text_;
  Lines lines_;
  Message* layer_ = nullptr;
  std::vector<UnreadPart> unread_;
};

}  // namespace

void mark(Message& layer, size_t index) {
  unknown_fields(layer).AddVarint(kMark, index);
}

std::string message_start(const std::string& name, TextPosition position) {
  return position.line == 0 ? name + ": "
                            : str(name, ":", position.line, ":", position.column, ": ");
}

ParsedText parse_net_text(const std::string& text, const std::string& name) {
  ParsedText parsed;
  FirstError complaint(text);
  if (parses(text, complaint, false, parsed.net) && parsed.net.IsInitialized()) return parsed;
  parsed.net.Clear();
  PartReader reader(text);
  if (reader.read(parsed.net)) return {std::move(parsed.net), reader.take()};
  // protobuf locates structural errors best if it ignores unknown fields.
  FirstError of_structure(text);
  caffe::NetParameter unused;
  const bool has_structure = parses(text, of_structure, true, unused);
  const Lines lines(text);
  // protobuf stops at an unknown enumeration value, which may precede the structural error.
  if (!has_structure && of_structure.is_of_value)
    throw InputError(message_start(name, lines.position(text.size())),
                     "is not closed or not well-formed: expected pairs of braces and quotes up to "
                     "here (is the file truncated?)");
  const FirstError& wrong = has_structure ? complaint : of_structure;
  throw InputError(message_start(name, lines.position(wrong.offset)),
                   wrong.reason.empty() ? "cannot be parsed" : wrong.reason);
}

void copy_marks(const Message& from, Message& to) {
  const auto& unknown = from.GetReflection()->GetUnknownFields(from);
  for (int i = 0; i < unknown.field_count(); ++i)
    if (unknown.field(i).number() >= kTypeMark) unknown_fields(to).AddField(unknown.field(i));
}

std::vector<size_t> take_marks(caffe::LayerParameter& layer) {
  std::vector<size_t> marks;
  const auto& unknown = layer.GetReflection()->GetUnknownFields(layer);
  for (int i = 0; i < unknown.field_count(); ++i)
    if (unknown.field(i).number() == kMark) marks.push_back(unknown.field(i).varint());
  unknown_fields(layer).Clear();
  return marks;
}

std::string marked_type(const caffe::V1LayerParameter& layer) {
  const auto& unknown = layer.GetReflection()->GetUnknownFields(layer);
  for (int i = 0; i < unknown.field_count(); ++i)
    if (unknown.field(i).number() == kTypeMark) return unknown.field(i).length_delimited();
  return "";
}

std::vector<TextPosition> locate(const std::string& text, const std::string& field) {
  const Lines lines(text);
  std::vector<TextPosition> positions;
  for (const TextField& found :
       text_fields(text, 0, text.size()).value_or(std::vector<TextField>()))
    if (found.name == field) positions.push_back(lines.position(found.begin));
  return positions;
}

}  // namespace revisit::proto
