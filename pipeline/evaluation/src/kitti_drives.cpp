#include "kitti_drives.h"

#include <algorithm>
#include <iterator>

#include "revisit/base/error.h"

namespace revisit::pipeline {
namespace {

struct Drive {
  const char* sequence;
  int64_t poses;
};
/// The odometry sequences that have poses.
constexpr Drive kDrives[] = {{"00", 4541}, {"01", 1101}, {"02", 4661}, {"03", 801},
                             {"04", 271},  {"05", 2761}, {"06", 1101}, {"07", 1101},
                             {"08", 4071}, {"09", 1591}, {"10", 1201}};

}  // namespace

void need_official_drive(const std::string& protocol, const std::string& sequence,
                         const Trajectory& trajectory) {
  const auto* const drive = std::find_if(std::begin(kDrives), std::end(kDrives),
                                         [&](const Drive& d) { return sequence == d.sequence; });
  const int64_t expected = drive == std::end(kDrives) ? 0 : drive->poses;
  if (trajectory.n_poses == expected) return;
  throw UsageError(str("protocol ", protocol, ": its frames are those of KITTI's drive ", sequence,
                       ", which has ", expected, " poses; this drive ", sequence, " has ",
                       trajectory.n_poses,
                       ", so it is another; paper-easy, online and leave-one-out work for any"));
}

}  // namespace revisit::pipeline
