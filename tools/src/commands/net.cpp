#include "cli/command.h"
#include "net_commands.h"

namespace revisit::cli {

int net_command(const Arguments& arguments) {
  return dispatch("revisit net",
                  "A Caffe net alone, from its original .prototxt and .caffemodel.\n",
                  {{"inspect", "layers, shapes, parameters, MACs and memory for any input size",
                    net_inspect_command},
                   {"forward", "run it on .npy arrays", net_forward_command},
                   {"profile", "time every layer and the whole", net_profile_command},
                   {"verify", "compare with outputs of the original", net_verify_command},
                   {"layers", "the layer types that networks can use", net_layers_command},
                   {"upgrade", "write an old prototxt or weights file in the current format",
                    net_upgrade_command}},
                  arguments);
}

}  // namespace revisit::cli
