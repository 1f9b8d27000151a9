#include "cli/command.h"
#include "net_commands.h"

namespace revisit::cli {

Command net_command() {
  return {"net",
          "run a Caffe net: inspect, forward, profile, verify",
          "Run a Caffe net from its original .prototxt and .caffemodel.\n",
          "",
          {},
          {net_inspect_command(), net_forward_command(), net_profile_command(),
           net_verify_command(), net_layers_command(), net_upgrade_command()}};
}

}  // namespace revisit::cli
