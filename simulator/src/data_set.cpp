#include "data_set.h"

#include <charconv>
#include <cstdio>

#include "revisit/base/error.h"
#include "revisit/base/hash.h"
#include "revisit/base/text.h"

namespace revisit::simulation {
namespace {

namespace fs = std::filesystem;

constexpr int kCameraVersion = 1;  // like kWorldVersion, for images

std::string numbered(int frame, const char* extension) {
  char name[24];
  std::snprintf(name, sizeof name, "%06d%s", frame, extension);
  return name;
}

void add_frames(const fs::path& folder, const char* extension, OutputFolder::Files* files) {
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    const std::string name = it->path().filename().string();
    int frame = -1;
    std::from_chars(name.data(), name.data() + name.size(), frame);
    if (frame >= 0 && name == numbered(frame, extension)) files->insert(it->path());
  }
}

std::string settings_of(const SimulationConfig& config, const Drive& drive) {
  std::string text = str("version: ", kWorldVersion, "\n");
  text += str("sensor: ", name_of(config.sensor), "\n");
  if (config.surroundings != Surroundings::kTown)
    text += str("surroundings: ", name_of(config.surroundings), "\n");
  if (config.traffic != 1) text += str("traffic: ", exact(config.traffic), "\n");
  if (const SensorMount& m = config.mount; m.height != kSensorHeight || m.pitch != 0 || m.roll != 0)
    text += str("mount: height ", exact(m.height), ", pitch ", exact(m.pitch), ", roll ",
                exact(m.roll), "\n");
  if (drive.given_poses.empty()) {
    const char* names[] = {"loop", "opposite", "both"};
    text += str("route: ", names[static_cast<int>(config.route)],
                "\nlength: ", exact(config.length), "\n");
  } else {
    text += str("poses: ", drive.poses.size(), " frames, fnv1a ", short_name_of(drive.given_poses),
                "\n");
  }
  text += str("calibration: fnv1a ", short_name_of(drive.calibration), "\n");
  text +=
      str("range-noise: ", exact(config.range_noise), "\ndropout: ", exact(config.dropout), "\n");
  if (config.rolling_shutter) text += "rolling-shutter: yes\n";
  if (config.camera)
    text += str("camera: ", drive.camera.width, " x ", drive.camera.height, ", ",
                config.camera->changing_light ? "changing" : "steady", " light, version ",
                kCameraVersion, "\n");
  return str(text, "seed: ", config.seed, "\n");
}

}  // namespace

DataSet::DataSet(const SimulationConfig& config, const Drive& drive)
    : sequence_(config.output / "sequences" / config.sequence),
      poses_file_(config.output / "poses" / (config.sequence + ".txt")),
      with_images_(config.camera.has_value()),
      with_times_(config.rolling_shutter),
      folder_(sequence_ / "simulation.txt", settings_of(config, drive)) {}

fs::path DataSet::scan_file(int frame) const {
  return sequence_ / "velodyne" / numbered(frame, with_times_ ? ".pcd" : ".bin");
}
fs::path DataSet::image_file(int frame) const {
  return sequence_ / "image_0" / numbered(frame, ".png");
}

std::set<int> DataSet::open(const std::set<int>& wanted, bool overwrite) {
  OutputFolder::Files there, files;
  for (const char* const extension : {".bin", ".pcd"})
    add_frames(sequence_ / "velodyne", extension, &there);
  add_frames(sequence_ / "image_0", ".png", &there);
  for (const int frame : wanted) {
    files.insert(scan_file(frame));
    if (with_images_) files.insert(image_file(frame));
  }
  const OutputFolder::Files done = folder_.open(
      files, there, {sequence_ / "calib.txt", sequence_ / "times.txt", poses_file_}, overwrite);
  std::set<int> complete;
  for (const int frame : wanted)
    if (done.contains(scan_file(frame)) && (!with_images_ || done.contains(image_file(frame))))
      complete.insert(frame);
  return complete;
}

void DataSet::write_frame(const std::string& poses, const std::string& calibration,
                          const std::string& times) {
  write_text(poses_file_, poses);
  write_text(sequence_ / "calib.txt", calibration);
  write_text(sequence_ / "times.txt", times);
}

}  // namespace revisit::simulation
