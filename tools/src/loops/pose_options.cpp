#include "pose_options.h"

#include "loops/scan_stream.h"
#include "revisit/base/error.h"

namespace revisit::cli {

void PoseOptions::declare(Options& options) {
  options.group("Poses:")
      .option("poses", "FILE", "poses of the scans (default: the data set's)", &file)
      .common()
      .choice<bool>("pose-frame", {{"lidar", false}, {"camera", true}},
                    "axes of --poses, which needs it, and of pose files that are written: "
                    "lidar (z up) or camera (x right, y down, z forward)",
                    &of_camera)
      .needs("poses")
      .common()
      .option("calib", "FILE",
              "T_body_lidar if the poses are not the lidar's: calib.txt of KITTI, or 3 x 4 numbers "
              "(default with camera: a camera that looks ahead)",
              &calib)
      .needs("poses")
      .option("max-gap", "SECONDS", "maximum time between a scan and its pose (default 0.1)",
              &max_gap)
      .at_least(0)
      .check([this] {
        if (!file.empty() && !of_camera)
          throw UsageError(
              "--poses: needs --pose-frame: lidar (z up; KISS-ICP, LIO, GNSS) or camera (z "
              "forward, y down; KITTI's poses)");
      });
}

std::vector<ScanRef> PoseOptions::scans_of(const Dataset& dataset) const {
  if (file.empty()) return with_sensor_poses(dataset);
  const std::optional<Pose> T_body_lidar =
      calib.empty() ? std::nullopt : std::optional(read_extrinsic(calib));
  std::vector<ScanRef> scans = dataset.scans;
  const std::vector<Pose> poses = poses_of(read_timed_poses(file), scans, max_gap);
  for (size_t i = 0; i < scans.size(); ++i)
    scans[i].pose = in_kitti_world(poses[i], *of_camera, T_body_lidar);
  return scans;
}

}  // namespace revisit::cli
