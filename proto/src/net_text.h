#pragma once

#include <string>
#include <vector>

#include "caffe_schema.pb.h"
#include "revisit/proto/net_file.h"

namespace revisit::proto {

/// Position in a text, both from 1; columns count bytes. Line 0: unknown.
struct TextPosition {
  int line = 0, column = 0;
};

/// Start of a message: `name:line:column: `, or `name: ` without a position.
std::string message_start(const std::string& name, TextPosition position);

struct UnreadPart {
  enum class Effect {
    kNone,     // no effect on inference
    kOnLoss,   // changes the value of a loss
    kOutside,  // no effect on the layer as far as this schema shows
    kUnknown   // may change results: must not be ignored
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

}  // namespace revisit::proto
