#include "read_binary.h"

#include <memory>
#include <string>
#include <vector>

#include "revisit/base/text.h"
#include "wire_reader.h"

namespace revisit::proto {
namespace {

using google::protobuf::Message;

/// Bytes of each field of a message, with its number.
std::vector<std::pair<uint32_t, std::string_view>> fields_of(std::string_view bytes) {
  FileCursor cursor(bytes, "<net>");
  WireReader reader(cursor, 0, bytes.size());
  std::vector<std::pair<uint32_t, std::string_view>> fields;
  uint64_t begin = 0;
  for (WireField field; reader.next(field); begin = field.end)
    fields.emplace_back(field.number, bytes.substr(begin, field.end - begin));
  return fields;
}

bool merge(std::string_view bytes, Message& into) {
  const std::unique_ptr<Message> read(into.New());
  if (!read->ParsePartialFromArray(bytes.data(), static_cast<int>(bytes.size()))) return false;
  into.MergeFrom(*read);
  return true;
}

/// Payload of a length-prefixed field.
std::string_view content_of(std::string_view field) {
  FileCursor cursor(field, "<field>");
  WireReader reader(cursor, 0, field.size());
  WireField read;
  reader.next(read);
  return field.substr(read.begin, read.end - read.begin);
}

}  // namespace

bool parse_binary(const std::string& bytes, caffe::NetParameter& net,
                  std::vector<std::string>& warnings) {
  if (net.ParsePartialFromString(bytes)) return true;
  net.Clear();
  try {
    for (const auto& [number, field] : fields_of(bytes)) {
      if (merge(field, net)) continue;
      const bool is_v1 = number == caffe::NetParameter::kLayersFieldNumber;
      if (!is_v1 && number != caffe::NetParameter::kLayerFieldNumber) return false;
      Message& layer = is_v1 ? static_cast<Message&>(*net.add_layers()) : *net.add_layer();
      std::vector<uint32_t> dropped;
      for (const auto& [of_layer, part] : fields_of(content_of(field)))
        if (!merge(part, layer)) dropped.push_back(of_layer);
      const std::string& name =
          is_v1 ? net.layers(net.layers_size() - 1).name() : net.layer(net.layer_size() - 1).name();
      warnings.push_back(str("layer '", name, "': skipped the fields ", joined(dropped, ", "),
                             ", whose numbers have another meaning in the fork that wrote them"));
    }
  } catch (const FormatError&) {
    return false;
  }
  return true;
}

std::string readable_net(const std::string& bytes) {
  caffe::NetParameter net;
  std::vector<std::string> warnings;
  if (!parse_binary(bytes, net, warnings))
    throw InputError("protobuf cannot parse the bytes as a NetParameter");
  return net.SerializePartialAsString();
}

}  // namespace revisit::proto
