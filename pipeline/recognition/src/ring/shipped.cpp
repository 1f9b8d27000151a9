// Embeds the files of ring_models/ by the assembler.
#include <algorithm>
#include <cstddef>

#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "revisit/recognition/ring/model.h"
#include "ring/model_content.h"

// NOLINTBEGIN(bugprone-macro-parentheses): a name that is declared has none.

// RING_MODEL(NAME, FILE): the bytes from NAME to NAME_end.
#define RING_MODEL(name, file)                                                                     \
  __asm__(".pushsection .rodata\n.balign 8\n.hidden " #name "\n.global " #name "\n" #name          \
          ":\n.incbin \"" REVISIT_RING_MODELS "/" file "\"\n.hidden " #name "_end\n.global " #name \
          "_end\n" #name "_end:\n.popsection\n");                                                  \
  extern "C" const char name[], name##_end[]
// NOLINTEND(bugprone-macro-parentheses)

RING_MODEL(revisit_ring_hdl64, "hdl64.ring");
RING_MODEL(revisit_ring_vlp16, "vlp16.ring");
RING_MODEL(revisit_ring_ouster_os1_64, "ouster-os1-64.ring");
RING_MODEL(revisit_ring_hdl64_squeezenet, "hdl64-squeezenet.ring");
RING_MODEL(revisit_ring_vlp16_squeezenet, "vlp16-squeezenet.ring");
RING_MODEL(revisit_ring_ouster_os1_64_squeezenet, "ouster-os1-64-squeezenet.ring");

namespace revisit {
namespace {

constexpr const char* kSqueezeNet = "0c5ba9eceae67db71dbfde095d807f4e1006c946";  // v1.0

struct Shipped {
  const char *sensor, *weights_sha1, *begin, *end;
};
const Shipped kShipped[] = {
    {"hdl64", "", revisit_ring_hdl64, revisit_ring_hdl64_end},
    {"vlp16", "", revisit_ring_vlp16, revisit_ring_vlp16_end},
    {"ouster-os1-64", "", revisit_ring_ouster_os1_64, revisit_ring_ouster_os1_64_end},
    {"hdl64", kSqueezeNet, revisit_ring_hdl64_squeezenet, revisit_ring_hdl64_squeezenet_end},
    {"vlp16", kSqueezeNet, revisit_ring_vlp16_squeezenet, revisit_ring_vlp16_squeezenet_end},
    {"ouster-os1-64", kSqueezeNet, revisit_ring_ouster_os1_64_squeezenet,
     revisit_ring_ouster_os1_64_squeezenet_end},
};

}  // namespace

std::vector<std::string> shipped_ring_models() {
  std::vector<std::string> names;
  for (const Shipped& model : kShipped)
    if (*model.weights_sha1 == '\0') names.emplace_back(model.sensor);
  return names;
}

std::string shipped_ring_sensor(const std::string& key) {
  for (const Shipped& model : kShipped)
    if (key.starts_with(ring_key(shipped_ring_model(model.sensor, model.weights_sha1))))
      return model.sensor;
  return "";
}

RingModel shipped_ring_model(const std::string& sensor, const std::string& weights_sha1) {
  const auto* const found = std::ranges::find_if(kShipped, [&](const Shipped& model) {
    return model.sensor == sensor && model.weights_sha1 == weights_sha1;
  });
  if (found == std::end(kShipped))
    throw UsageError("no ring model for the sensor '", sensor, "'",
                     weights_sha1.empty() ? "" : " and these weights", "; there are models for ",
                     joined(shipped_ring_models(), ", "),
                     weights_sha1.empty() ? ""
                                          : str(", and with the weights of SqueezeNet v1.0 (SHA-1 ",
                                                kSqueezeNet, ")"),
                     ": train one with ", CppName{"learn_ring_model"});
  return parse_ring_model({found->begin, static_cast<size_t>(found->end - found->begin)},
                          "the ring model of " + sensor);
}

}  // namespace revisit
