#pragma once

#include <google/protobuf/descriptor.h>

#include <string>
#include <string_view>

#include "net_text.h"

namespace revisit::proto {

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
