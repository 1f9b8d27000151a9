#pragma once

#include <string>
#include <vector>

#include "caffe_schema.pb.h"
#include "revisit/proto/net_file.h"

namespace revisit::proto {

/// Where in a text, both from 1; the column counts bytes. Line 0: nowhere in particular.
struct TextPosition {
  int line = 0, column = 0;
};

/// `name:line:column: ` or `name: `, to begin a message with.
std::string message_start(const std::string& name, TextPosition position);

/// A part of a text that the net does not have, because it does not parse.
struct UnreadPart {
  enum class Effect {
    kNone,     // none on what inference computes
    kOnLoss,   // on the value of a loss
    kOutside,  // none on what the layer computes as far as this schema tells
    kUnknown   // maybe on results: nobody may drop it
  };
  TextPosition position;
  std::string reason;
  Effect effect = Effect::kUnknown;
  bool in_layer = false;
};

/// A net, and what is missing in it. Marks in the layers tell whose parts are missing.
struct ParsedText {
  caffe::NetParameter net;
  std::vector<UnreadPart> unread;  // in the order of the text
};

/// Parses prototxt text as it stands, without upgrading. Throws InputError with the position for a
/// text that has no structure; what does not parse inside of its structure is left out.
ParsedText parse_net_text(const std::string& text, const std::string& name);

/// Marks a layer: part `index` of ParsedText::unread is its own.
void mark(google::protobuf::Message& layer, size_t index);
/// Gives `to` the marks of `from`, which it takes the place of.
void copy_marks(const google::protobuf::Message& from, google::protobuf::Message& to);
/// Takes the marks from a layer: indices into ParsedText::unread.
std::vector<size_t> take_marks(caffe::LayerParameter& layer);
/// The type of a V1 layer whose type is none of V1's, as the text has it; else "".
std::string marked_type(const caffe::V1LayerParameter& layer);

/// Where the entries of NetParameter's `field` stand in a text that parses.
std::vector<TextPosition> locate(const std::string& text, const std::string& field);

}  // namespace revisit::proto
