#include "pose_options.h"

#include "loops/scan_stream.h"
#include "revisit/base/error.h"

namespace revisit::cli {

using pipeline::PoseFormat;
using pipeline::PoseFrame;

void PoseOptions::declare(Parser& parser) {
  parser.group("Poses:")
      .option("poses", "FILE", "of the scans (default: those of the data set)", &file)
      .choice<PoseFormat>(
          "pose-format",
          {{"kitti", PoseFormat::kKitti}, {"tum", PoseFormat::kTum}, {"euroc", PoseFormat::kEuroc}},
          "default: detected", &format)
      .choice<PoseFrame>(
          "pose-frame", {{"lidar", PoseFrame::kLidar}, {"camera", PoseFrame::kCamera}},
          "lidar: z is up in the world; camera: x to the right, y down, z forward. Needed with "
          "--poses; files of poses that are written have the same",
          &frame)
      .option("calib", "FILE",
              "T_body_lidar when the poses are not the lidar's: calib.txt of KITTI, or 3 x 4 "
              "numbers (default with camera: one that looks ahead)",
              &calib)
      .option("max-gap", "SECONDS", "between a scan and its pose (default 0.1)", &max_gap);
}

void PoseOptions::check(const Parser& parser) const {
  if (!file.empty() && !frame)
    throw UsageError(
        "--poses: say whose axes they have with --pose-frame: lidar (z up; KISS-ICP, LIO, GNSS) or "
        "camera (z forward, y down; KITTI's poses)");
  for (const char* option : {"pose-format", "pose-frame", "calib"})
    if (file.empty() && parser.given(option))
      throw UsageError("--", option, " is about --poses, which is not given");
  if (!(max_gap >= 0)) throw UsageError("--max-gap: expected a number of seconds, found ", max_gap);
}

std::vector<pipeline::ScanRef> PoseOptions::scans_of(const pipeline::Dataset& dataset) const {
  if (file.empty()) return with_sensor_poses(dataset);
  const std::optional<pipeline::Pose> T_body_lidar =
      calib.empty() ? std::nullopt : std::optional(pipeline::read_extrinsic(calib));
  std::vector<pipeline::ScanRef> scans = dataset.scans;
  const std::vector<pipeline::Pose> poses =
      poses_of(pipeline::read_timed_poses(file, format), scans, max_gap);
  for (size_t i = 0; i < scans.size(); ++i)
    scans[i].pose = in_kitti_world(poses[i], *frame, T_body_lidar);
  return scans;
}

}  // namespace revisit::cli
