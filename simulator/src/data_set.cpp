#include "data_set.h"

#include <omp.h>

#include <algorithm>
#include <atomic>
#include <charconv>
#include <cstdio>
#include <mutex>
#include <sstream>

#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/base/hash.h"
#include "revisit/base/text.h"
#include "revisit/datasets/observer.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/engine/parallel_for.h"
#include "scenery.h"

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
  text += str("sensor: ", config.sensor, "\n");
  if (config.surroundings != "town") text += str("surroundings: ", config.surroundings, "\n");
  if (config.traffic != 1) text += str("traffic: ", exact(config.traffic), "\n");
  const double usual = scenery_of(config.surroundings).sensor_height;
  const double height = config.sensor_height.value_or(usual);
  if (height != usual || config.sensor_pitch != 0 || config.sensor_roll != 0)
    text += str("mount: height ", exact(height), ", pitch ", exact(config.sensor_pitch), ", roll ",
                exact(config.sensor_roll), "\n");
  if (drive.given_poses.empty()) {
    text += str("route: ", config.route, "\nlength: ", exact(config.length), "\n");
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
                config.changing_light ? "changing" : "steady", " light, version ", kCameraVersion,
                "\n");
  return str(text, "seed: ", config.seed, "\n");
}

constexpr const char* kOverwrite = "overwrite";
constexpr const char* kHeader = "# revisit simulate: the settings of the scans beside this file\n";

}  // namespace

DataSet::DataSet(const SimulationConfig& config, const Drive& drive)
    : sequence_(config.output / "sequences" / config.sequence),
      poses_file_(config.output / "poses" / (config.sequence + ".txt")),
      with_images_(config.camera),
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

OutputFolder::OutputFolder(fs::path settings_file, const std::string& settings)
    : settings_file_(std::move(settings_file)),
      settings_(str(kHeader, settings, "hash: ", short_name_of(settings), "\n")) {}

std::string OutputFolder::difference(const std::string& known) const {
  std::istringstream there(known), ours(settings_);
  std::string a, b;
  while (std::getline(there, a) && std::getline(ours, b))
    if (a != b) return str("there '", a, "', now '", b, "'");
  return "they end differently";
}

OutputFolder::Files OutputFolder::open(const Files& wanted, const Files& there,
                                       const std::vector<fs::path>& others, bool overwrite) const {
  const std::string known = content_if_any(settings_file_);
  const std::string folder = settings_file_.parent_path().string();
  if (known.empty()) {
    // These may be real recordings, so they are never touched, whatever the options.
    std::vector<fs::path> strange = others;
    if (!there.empty()) strange.push_back(*there.begin());
    for (const fs::path& file : strange)
      if (std::error_code unknown; fs::exists(file, unknown))
        throw UsageError(file.string(), " already exists and was not made by a simulation (no ",
                         settings_file_.string(), "): choose another output or sequence");
  } else if (!known.starts_with(kHeader)) {
    throw UsageError(settings_file_.string() +
                     " exists but is not a settings file of a simulation: choose another output");
  } else if (known != settings_ && !overwrite) {
    throw UsageError(folder, " holds ", there.size(), " files made with other settings (",
                     difference(known), "): choose another output or sequence, or replace them (",
                     kOverwrite, ")");
  }
  // Files that this run would not write: all files of other settings, or unrequested ones.
  Files stale = there;
  if (known == settings_) {
    stale.clear();
    std::set_difference(there.begin(), there.end(), wanted.begin(), wanted.end(),
                        std::inserter(stale, stale.end()));
    if (!stale.empty() && !overwrite)
      throw UsageError(folder, " holds ", stale.size(), " more files than requested (",
                       stale.begin()->filename().string(),
                       "): request more frames, choose another output, or remove them (",
                       kOverwrite, ")");
  }
  for (const fs::path& file : stale) {
    std::error_code error;
    fs::remove(file, error);
    if (error) throw Error("cannot remove ", file.string(), ": ", error.message());
  }
  Files complete;
  for (const fs::path& file : wanted) {
    make_folder(file.parent_path());
    if (there.contains(file) && !stale.contains(file)) complete.insert(file);
  }
  write_text(settings_file_, settings_);
  return complete;
}

void write_text(const fs::path& file, const std::string& text) {
  if (content_if_any(file) == text) return;
  make_folder(file.parent_path());
  write_atomically(file, [&](std::ostream& out) { out << text; });
}

int threads_for(int requested, int64_t items) {
  const int64_t most = requested > 0 ? requested : omp_get_max_threads();
  return static_cast<int>(std::clamp<int64_t>(items, 1, most));
}

void run_scans(int64_t missing, int threads, const std::filesystem::path& folder,
               const std::function<void(int64_t item, int thread)>& take,
               const std::function<void(int64_t, int64_t)>& progress,
               const std::function<bool()>& stop, SimulationSummary& summary) {
  auto lap = stopwatch();
  const int64_t total = summary.scans + missing;
  std::mutex mutex;
  std::atomic<bool> stopped = false;
  parallel_for(missing, threads, [&](int64_t item, int thread) {
    if (stopped) return;
    take(item, thread);
    const std::scoped_lock lock(mutex);
    ++summary.scans;
    if (progress) progress(summary.scans, total);
    if (!stopped && stop && summary.scans < total && stop()) stopped = true;
  });
  if (stopped)
    throw Interrupted("interrupted: ", summary.scans, " of ", total, " scans are complete in ",
                      folder.string(), "; run the same command again to resume");
  summary.scan_seconds = lap() / 1000;
}

namespace {

constexpr size_t kPcdHeaderBytes = 166, kPcdPointBytes = sizeof(Point) + sizeof(float);

}  // namespace

void write_pcd_scan(const std::filesystem::path& file, const PointCloud& cloud) {
  if (cloud.times.size() != cloud.points.size())
    throw UsageError(file.string(), ": expected a time for each of the ", cloud.points.size(),
                     " points, found ", cloud.times.size());
  char header[kPcdHeaderBytes + 1];
  std::snprintf(header, sizeof header,
                "VERSION 0.7\nFIELDS x y z intensity time\nSIZE 4 4 4 4 4\nTYPE F F F F F\n"
                "COUNT 1 1 1 1 1\nWIDTH %10zu\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n"
                "POINTS %10zu\nDATA binary\n",
                cloud.points.size(), cloud.points.size());
  write_atomically(file, [&](std::ostream& out) {
    out << header;
    for (size_t i = 0; i < cloud.points.size(); ++i) {
      out.write(reinterpret_cast<const char*>(&cloud.points[i]), sizeof(Point));
      out.write(reinterpret_cast<const char*>(&cloud.times[i]), sizeof(float));
    }
  });
}

double mean_points(std::span<const std::filesystem::path> files) {
  uintmax_t points = 0;
  for (const std::filesystem::path& file : files) {
    const uintmax_t bytes = std::filesystem::file_size(file);
    points += file.extension() == ".pcd" ? (bytes - kPcdHeaderBytes) / kPcdPointBytes
                                         : bytes / sizeof(Point);
  }
  return static_cast<double>(points) / static_cast<double>(files.size());
}

}  // namespace revisit::simulation
