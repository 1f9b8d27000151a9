#include "cli/command.h"
#include "net_commands.h"

namespace revisit::cli {

int net_command(const Arguments& arguments) {
  return dispatch(
      "revisit net", "Run a Caffe net from its original .prototxt and .caffemodel.\n",
      {{"inspect", "layers, shapes, parameters, MACs and memory", net_inspect_command},
       {"forward", "outputs for .npy arrays or pictures", net_forward_command},
       {"profile", "time of every layer and of the net", net_profile_command},
       {"verify", "comparison with outputs of the original", net_verify_command},
       {"layers", "supported layer types", net_layers_command},
       {"upgrade", "an old prototxt or weights file in the current format", net_upgrade_command}},
      arguments);
}

}  // namespace revisit::cli
