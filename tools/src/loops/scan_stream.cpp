#include "scan_stream.h"

#include <chrono>
#include <deque>
#include <istream>
#include <memory>
#include <set>
#include <thread>

#include "cli/messages.h"
#include "revisit/base/error.h"
#include "revisit/datasets/dataset.h"
#include "revisit/datasets/scan_file.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

Pose calibration_of(const fs::path& scan) {
  const fs::path file = scan.parent_path().parent_path() / "calib.txt";
  return fs::exists(file) ? read_kitti_calibration(file) : axes_of_camera();
}

}  // namespace

std::vector<ScanRef> with_sensor_poses(Dataset dataset) {
  if (dataset.has_poses()) {
    const Pose T_cam_sensor = calibration_of(dataset.scans.front().file);
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

ScanStream scans_listed_in(std::istream& list) {
  return [&list, frame = 0]() mutable -> std::optional<ScanRef> {
    for (std::string line; std::getline(list, line);)
      if (!line.empty()) {
        ScanRef scan;
        scan.file = line;
        scan.frame = frame++;
        scan.time = time_in_name(scan.file);
        return scan;
      }
    return std::nullopt;
  };
}

ScanStream scans_coming(const std::function<Dataset()>& so_far, double patience,
                        const std::function<bool()>& stop) {
  using Clock = std::chrono::steady_clock;
  struct Watch {
    std::set<fs::path> handed_over;
    std::set<int> frames;  // of those handed over
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
      // Files without numbers are counted, so a late file can get the number of another.
      if (!watch.frames.insert(scan.frame).second)
        watch.frames.insert(scan.frame = *watch.frames.rbegin() + 1);
      watch.ready.push_back(std::move(scan));
    }
  };
  return [=, watch = std::make_shared<Watch>()]() -> std::optional<ScanRef> {
    constexpr auto kMoment = std::chrono::milliseconds(100);
    const Clock::time_point start = Clock::now();
    while (watch->ready.empty()) {
      look(*watch);
      if (!watch->ready.empty()) break;
      if (stop()) return std::nullopt;
      if (std::chrono::duration<double>(Clock::now() - start).count() > patience) {
        if (watch->error && watch->handed_over.empty()) throw *watch->error;
        if (watch->error) warn(watch->error->what());
        return std::nullopt;
      }
      std::this_thread::sleep_for(kMoment);
    }
    ScanRef scan = std::move(watch->ready.front());
    watch->ready.pop_front();
    return scan;
  };
}

}  // namespace revisit::cli
