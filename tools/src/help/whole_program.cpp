#include "help/whole_program.h"

namespace revisit::help {

cli::CommandLine whole_program() {
  cli::CommandLine line = cli::describe(cli::revisit_command);
  line.headline = "place recognition from LiDAR scans with original Caffe networks";
  line.summary =
      "revisit tells a vehicle with a 360-degree LiDAR when it is back at a place it has seen. It "
      "turns each scan into a range image and describes the image with the first layers of a "
      "network that was trained on photographs. It reads original Caffe networks and runs them on "
      "the CPU, without Caffe.";
  line.groups.front().options.push_back({"version", 0, "print the version", {}});
  return line;
}

}  // namespace revisit::help
