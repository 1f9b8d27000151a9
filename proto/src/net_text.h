#pragma once

#include <google/protobuf/descriptor.h>
#include <google/protobuf/io/tokenizer.h>

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "caffe_schema.pb.h"

namespace revisit::proto {

/// Discards errors, which protobuf would log otherwise.
class Silence final : public google::protobuf::io::ErrorCollector {
  void AddError(int, google::protobuf::io::ColumnNumber, const std::string&) override {}
};

/// Position in a text, both from 1; columns count bytes. Line 0: unknown.
struct TextPosition {
  int line = 0, column = 0;
};

/// Start of a message: `name:line:column: `, or `name: ` without a position.
std::string message_start(const std::string& name, TextPosition position);

struct UnreadPart {
  enum class Effect {
    kNone,         // no effect on inference
    kOnLoss,       // changes the value of a loss
    kOutside,      // outside of layer parameters: may be ignored on request
    kOnPrecision,  // data types of Intel's quantized layers, whose weights are in float32
    kUnknown       // may change results: must not be ignored
  };
  TextPosition position;
  std::string reason;
  Effect effect = Effect::kUnknown;
  bool in_layer = false;
};

/// Marks in the layers refer to `unread` by index.
struct ParsedText {
  caffe::NetParameter net;
  std::vector<UnreadPart> unread;  // in the order of the text
};

/// Parses prototxt text without upgrading it. Throws InputError with the position if the structure
/// is invalid; parts that do not parse within it are skipped and returned.
ParsedText parse_net_text(const std::string& text, const std::string& name);

/// Marks a layer with one of its unread parts, ParsedText::unread[index].
void mark(google::protobuf::Message& layer, size_t index);
void copy_marks(const google::protobuf::Message& from, google::protobuf::Message& to);
/// Removes and returns indices into ParsedText::unread.
std::vector<size_t> take_marks(caffe::LayerParameter& layer);
/// The type text of a V1 layer if it is not a V1 type, else "".
std::string marked_type(const caffe::V1LayerParameter& layer);

/// Positions of the entries of NetParameter's `field` in a text that parses.
std::vector<TextPosition> locate(const std::string& text, const std::string& field);

/// Formats the message for a field that `message` lacks, with a hint: the nearest name if it is
/// misspelled, the parameters that have it in a layer of `type`, or the fork that defines it.
std::string unknown_field(const std::string& field, const google::protobuf::Descriptor& message,
                          const std::string& type);

/// Effect of a field that a message lacks or whose value it cannot hold. `reached_by` is the field
/// that contains the message; `is_message` is true if the value of the field is a message.
UnreadPart::Effect effect_of(std::string_view field, const google::protobuf::Descriptor& message,
                             std::string_view reached_by, bool is_message);

bool is_supported_loss(std::string_view type);

/// Returns whether a field selects an implementation, such as `engine` and its variants in forks.
bool selects_implementation(std::string_view field);

}  // namespace revisit::proto
