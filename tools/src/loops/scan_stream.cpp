#include "scan_stream.h"

#include <algorithm>
#include <chrono>
#include <deque>
#include <iostream>
#include <map>
#include <memory>
#include <set>
#include <thread>
#include <utility>

#include "cli/terminal.h"
#include "loops/recording.h"
#include "revisit/base/error.h"
#include "revisit/datasets/dataset.h"
#include "revisit/datasets/scan_file.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// Reads one file name per line and skips empty lines. Frames are numbered as in a folder, by names
/// if their numbers ascend.
ScanStream scans_listed_in(std::istream& list, std::string first) {
  return [&list, line = std::move(first), last = -1]() mutable -> std::optional<ScanRef> {
    do {
      if (line.ends_with('\r')) line.pop_back();  // of a list that was written on Windows
    } while (line.empty() && std::getline(list, line));
    if (line.empty()) return std::nullopt;
    ScanRef scan;
    scan.file = std::exchange(line, "");
    scan.frame = last = std::max(last + 1, number_in_name(scan.file).value_or(0));
    scan.time = time_in_name(scan.file);
    return scan;
  };
}

/// Scans of a data set, and those that come while it is watched. A file is complete once a later
/// one exists or its size stays for a moment. Ends if interrupted or if none came for `patience`
/// seconds; an InputError of `so_far` is then thrown if none ever came, else printed.
ScanStream scans_coming(const std::function<Dataset()>& so_far, double patience) {
  using Clock = std::chrono::steady_clock;
  struct Watch {
    std::set<fs::path> handed_over;
    std::optional<int> frame;  // of the last one
    std::deque<ScanRef> ready;
    uintmax_t size = 0;               // of the newest file at the last look
    std::optional<InputError> error;  // of the last look; a later look may succeed
  };
  const auto look = [so_far](Watch& watch) {
    std::vector<ScanRef> scans;
    watch.error.reset();
    try {
      scans = with_sensor_poses(so_far());
    } catch (const InputError& error) {
      watch.error = error;
    }
    std::erase_if(scans,
                  [&](const ScanRef& scan) { return watch.handed_over.contains(scan.file); });
    if (scans.empty()) return;
    std::error_code gone;
    const uintmax_t size = fs::file_size(scans.back().file, gone);
    if (gone || size == 0 || size != watch.size) scans.pop_back();  // still being written
    watch.size = size;
    for (ScanRef& scan : scans) {
      watch.handed_over.insert(scan.file);
      // Files without numbers are counted, and files may come late: frames ascend nevertheless.
      if (watch.frame && scan.frame <= *watch.frame) scan.frame = *watch.frame + 1;
      watch.frame = scan.frame;
      watch.ready.push_back(std::move(scan));
    }
  };
  return [=, watch = std::make_shared<Watch>()]() -> std::optional<ScanRef> {
    const Clock::time_point start = Clock::now();
    while (watch->ready.empty()) {
      look(*watch);
      if (!watch->ready.empty()) break;
      if (interrupted()) return std::nullopt;
      if (std::chrono::duration<double>(Clock::now() - start).count() > patience) {
        if (watch->error && watch->handed_over.empty()) throw *watch->error;
        if (watch->error) warn(watch->error->what());
        return std::nullopt;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
    ScanRef scan = std::move(watch->ready.front());
    watch->ready.pop_front();
    return scan;
  };
}

/// First scans of a stream until `enough` are readable, which show the sensor.
std::vector<ScanRef> first_readable(const ScanStream& stream, size_t enough) {
  constexpr size_t kTried = 20;
  std::vector<ScanRef> scans;
  size_t readable = 0;
  while (scans.size() < kTried && readable < enough) {
    std::optional<ScanRef> scan = stream();
    if (!scan) break;
    try {
      read_scan(*scan);
      ++readable;
    } catch (const InputError&) {  // reported when the scan is read again
    }
    scans.push_back(std::move(*scan));
  }
  return scans;
}

/// Begins with the first scans, which wait in memory and show the convention of times of points.
ScanSource source_of(RecordedScans scans, size_t enough, const std::string& name,
                     const std::string& unit) {
  ScanSource source;
  source.some = {.name = scans.name, .scans = first_readable(scans.next, enough)};
  source.count = scans.count;
  if (source.some.scans.empty()) throw InputError(name, ": there are no scans");
  source.some.point_times = scans.point_times;
  find_point_times(source.some, unit);
  source.next = [next = chained(source.some.scans, std::move(scans.next)),
                 times = source.some.scans[0].point_times] {
    std::optional<ScanRef> scan = next();
    if (scan) scan->point_times = times;
    return scan;
  };
  return source;
}

/// Reads the recording twice if the poses are in a file, which gives them to scans by their times.
ScanSource recording_source(const FeatureOptions& data, const PoseOptions& poses) {
  std::map<int, std::optional<Pose>> by_frame;
  if (!poses.file.empty()) {
    const Dataset scans = headers_of(data);
    if (!scans.scans.empty())
      for (const ScanRef& scan : poses.scans_of(scans)) by_frame[scan.frame] = scan.pose;
  }
  RecordedScans scans = read_recording(data);
  if (!data.quiet)
    for (const std::string& warning : scans.warnings) warn(warning);
  if (!by_frame.empty())
    scans.next = [by_frame = std::move(by_frame), next = std::move(scans.next)]() mutable {
      std::optional<ScanRef> scan = next();
      if (scan) scan->pose = by_frame[scan->frame];
      return scan;
    };
  return source_of(std::move(scans), kShowSensor, data.data.string(), data.point_times);
}

/// Scans or names of files. All names are read at once, so that scans of the whole drive show the
/// sensor, as in a folder; if they are followed, one by one.
ScanSource standard_input(const FeatureOptions& data, bool is_followed) {
  const std::string name = "standard input";
  std::string line;
  std::getline(std::cin, line);
  RecordedScans scans;
  const bool has_points = begins_recorded_scans(line);
  if (has_points)
    scans = recorded_scans(std::cin, name, line);
  else
    scans.next = scans_listed_in(std::cin, std::move(line));
  scans.next = [next = std::move(scans.next), every = data.every] {
    std::optional<ScanRef> scan = next();
    while (scan && scan->frame % every != 0) scan = next();
    return scan;
  };
  if (has_points || is_followed) return source_of(std::move(scans), 1, name, data.point_times);
  Dataset dataset;
  while (std::optional<ScanRef> scan = scans.next()) dataset.scans.push_back(std::move(*scan));
  if (dataset.scans.empty()) throw InputError(name, ": there are no scans");
  if (!std::ranges::all_of(dataset.scans, &std::optional<double>::has_value, &ScanRef::time))
    for (ScanRef& scan : dataset.scans) scan.time.reset();
  find_point_times(dataset, data.point_times);
  const auto count = std::ssize(dataset.scans);
  return {stream_of(dataset.scans), std::move(dataset), count};
}

ScanSource growing(const FeatureOptions& data, double patience) {
  // Holds name and sequence of the last look that succeeded.
  const auto last = std::make_shared<Dataset>();
  ScanSource source = source_of(
      {.next = scans_coming([data, last] { return *last = scans_so_far(data); }, patience)}, 1,
      data.data.string(), data.point_times);
  source.some.name = last->name;
  source.some.sequence = last->sequence;
  return source;
}

void warn_of_folders(const fs::path& data, const Dataset& dataset) {
  std::vector<std::string> folders;
  for (const ScanRef& scan : dataset.scans)
    if (folders.empty() || folders.back() != scan.place) folders.push_back(scan.place);
  warn(str(data.string(), ": has no scans; its ", folders.size(), " folders (", folders.front(),
           " to ", folders.back(),
           ") are taken as one drive, in this order; else give one of them"));
}

}  // namespace

std::vector<ScanRef> with_sensor_poses(Dataset dataset) {
  if (dataset.camera_axes) {
    const fs::path calib = dataset.scans[0].file.parent_path().parent_path() / "calib.txt";
    const Pose T_cam_sensor = fs::exists(calib) ? read_kitti_calibration(calib) : axes_of_camera();
    for (ScanRef& scan : dataset.scans)
      if (scan.pose) scan.pose = *scan.pose * T_cam_sensor;
  }
  return std::move(dataset.scans);
}

ScanStream stream_of(std::vector<ScanRef> scans) {
  return [scans = std::move(scans), next = size_t{0}]() mutable -> std::optional<ScanRef> {
    if (next == scans.size()) return std::nullopt;
    return scans[next++];
  };
}

ScanStream chained(std::vector<ScanRef> first, ScanStream rest) {
  return [first = stream_of(std::move(first)), rest = std::move(rest)] {
    std::optional<ScanRef> scan = first();
    return scan ? scan : rest();
  };
}

ScanSource open_source(const FeatureOptions& data, const PoseOptions& poses,
                       std::optional<double> follow) {
  const bool listed = data.data == "-";
  if (!poses.file.empty() && (follow || listed))
    throw UsageError("--poses: not supported with ", follow ? "--follow" : "standard input");
  if (listed && !(data.sequence.empty() && data.topics.empty()))
    throw UsageError("--sequence, --topics: not supported with standard input");
  if (listed) return standard_input(data, follow.has_value());
  if (is_recording(data.data)) {
    if (follow) throw UsageError("--follow: not supported for recordings");
    return recording_source(data, poses);
  }
  if (std::error_code error; fs::is_regular_file(data.data, error))
    throw InputError(data.data.string(),
                     ": expected a folder of scans or a recording, found another file");
  if (follow) return growing(data, *follow);
  FeatureOptions untimed = data;  // without open_scans()'s note
  untimed.point_times = "none";
  Dataset dataset = open_scans(untimed);
  if (dataset.has_places() && !data.quiet) warn_of_folders(data.data, dataset);
  find_point_times(dataset, data.point_times);
  dataset.scans = poses.scans_of(dataset);
  const auto count = static_cast<int64_t>(dataset.scans.size());
  return {stream_of(dataset.scans), std::move(dataset), count};
}

void PoseOptions::declare(Options& options) {
  options.group("Poses:")
      .option("poses", "FILE", "poses of the scans (default: the data set's)", &file)
      .common()
      .choice<bool>("pose-frame", {{"lidar", false}, {"camera", true}},
                    "axes of --poses, which needs it, and of all poses that are written: "
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
  const Pose ahead = *of_camera ? axes_of_camera() : Pose::Identity();
  std::vector<ScanRef> scans = dataset.scans;
  const std::vector<Pose> poses = poses_of(read_timed_poses(file), scans, max_gap);
  double path = 0;
  for (size_t i = 0; i < scans.size(); ++i) {
    scans[i].pose = poses[i] * T_body_lidar.value_or(ahead);
    path += i > 0 ? (poses[i].translation() - poses[i - 1].translation()).norm() : 0;
  }
  const double step = path / static_cast<double>(scans.size());  // [m]
  if (scans.size() >= 10 && (step < 1e-3 || step > 50))
    warn(str(file.string(), ": its poses of ", scans.size(), " scans have a path of ", path,
             " m; expected meters, and scans with stamps that increase"));
  return scans;
}

}  // namespace revisit::cli
