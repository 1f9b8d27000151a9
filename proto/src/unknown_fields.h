#pragma once

#include <google/protobuf/descriptor.h>

#include <string>
#include <string_view>

#include "net_text.h"

namespace revisit::proto {

/// What to say of a field that the message lacks, with the nearest name if it is a misspelling, the
/// parameters of a layer of `type` that have it, or the fork that defines it.
std::string unknown_field(const std::string& field, const google::protobuf::Descriptor& message,
                          const std::string& type);

/// What it does that a message lacks a field, or cannot take its value. `reached_by` is the field
/// whose value the message is; `is_message` tells whether the value of the field is one.
UnreadPart::Effect effect_of(std::string_view field, const google::protobuf::Descriptor& message,
                             std::string_view reached_by, bool is_message);

/// Whether the engine computes the value of a loss of this type, so that its parameters matter.
bool is_loss_that_runs(std::string_view type);

/// Whether a field says how to compute, not what: any fork's `engine`.
bool chooses_engine(std::string_view field);

}  // namespace revisit::proto
