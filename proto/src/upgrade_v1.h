#pragma once

#include <string>

#include "caffe_schema.pb.h"

namespace revisit::proto {

/// The type of the current form for one of V1, or of a fork that V1 lacks; "" if there is none.
std::string type_of_v1(std::string capitals);

/// Sets `name` in the sub-message `message` of `to` to the value of a set field that is called
/// otherwise elsewhere, as text says it. False when the value does not fit there.
bool merge_field(const google::protobuf::Message& from,
                 const google::protobuf::FieldDescriptor& field, const std::string& message,
                 const std::string& name, google::protobuf::Message& to);

/// Moves scale, mean_file, crop_size and mirror of V1 data layers into `transform_param`.
void upgrade_data_transform(caffe::NetParameter& net);

/// Turns V1 `layers` (2014: types are an enum) into V2 `layer`. The net has no V2 layer yet.
void upgrade_v1(caffe::NetParameter& net);

}  // namespace revisit::proto
