#pragma once

#include <string>

#include "caffe_schema.pb.h"

namespace revisit::proto {

/// Returns the V2 type for a V1 type, or for one of a fork that V1 lacks; "" if there is none.
std::string type_of_v1(std::string capitals);

/// Sets field `name` in the sub-message `message` of `to` to the value of a set field with another
/// name, via text. Returns false if the value does not fit.
bool merge_field(const google::protobuf::Message& from,
                 const google::protobuf::FieldDescriptor& field, const std::string& message,
                 const std::string& name, google::protobuf::Message& to);

/// Moves scale, mean_file, crop_size and mirror of V1 data layers into `transform_param`.
void upgrade_data_transform(caffe::NetParameter& net);

/// Requires a net without V2 layers.
void upgrade_v1(caffe::NetParameter& net);

}  // namespace revisit::proto
