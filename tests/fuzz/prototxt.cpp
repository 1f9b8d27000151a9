// Text of a network: parsed, upgraded, written and read again; then its graph and plan.
#include <google/protobuf/text_format.h>

#include "fuzz.h"
#include "revisit/engine/net.h"
#include "revisit/proto/net_file.h"

namespace revisit::fuzz {
namespace {

std::string printed(const caffe::NetParameter& net) {
  std::string text;
  google::protobuf::TextFormat::PrintToString(net, &text);
  return text;
}

/// Text written in the current form must be read back unchanged.
void round_trip(const caffe::NetParameter& net) {
  const std::string once = printed(net);
  std::string twice;
  try {
    twice = printed(proto::parse_net(once, "upgraded").net);
  } catch (const Error& error) {
    twice = error.what();
  }
  require(once == twice, "an upgraded net is read back unchanged");
}

void plan(const std::string& text) {
  const InputFile file(text);
  const engine::Net net = engine::Net::load_without_weights(file.path(), {.allow_unknown = true});
  net.plan();
  const std::string last = net.layer_names().back();
  engine::Net::load_without_weights(file.path(), {.end = last, .allow_unknown = true})
      .plan({}, {.keep_all = true});
}

}  // namespace
}  // namespace revisit::fuzz

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace revisit;
  const std::string text = fuzz::text(data, size);
  fuzz::works_or_refuses([&] { proto::parse_net(text, "strict"); });
  fuzz::works_or_refuses([&] {
    fuzz::round_trip(proto::parse_net(text, "lenient", {.allow_unknown_fields = true}).net);
    fuzz::plan(text);
  });
  return 0;
}
