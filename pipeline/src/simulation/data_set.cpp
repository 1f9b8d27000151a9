#include "simulation/data_set.h"

#include <algorithm>
#include <charconv>
#include <cstdio>
#include <fstream>
#include <sstream>

#include "revisit/proto/atomic_file.h"
#include "revisit/proto/error.h"

namespace revisit::pipeline::simulation {
namespace {

namespace fs = std::filesystem;

constexpr const char* kHeader = "# revisit simulate: the settings of the scans beside this file\n";
/// To be raised with every change that changes scans: old ones must not be continued.
constexpr int kWorldVersion = 1;

/// "" when there is no such file.
std::string content(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream text;
  if (in) text << in.rdbuf();
  return std::move(text).str();
}

void write_text(const fs::path& file, const std::string& text) {
  if (content(file) == text) return;
  write_atomically(file, [&](std::ostream& out) { out << text; });
}

void make_folder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw Error(str(folder.string(), ": cannot create the folder: ", error.message()));
}

/// FNV-1a, 64 bits.
std::string fingerprint(const std::string& bytes) {
  uint64_t hash = 0xcbf29ce484222325u;
  for (const char c : bytes) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3u;
  char text[17];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(hash));
  return text;
}

std::string exact(double value) {
  char text[32];
  const auto end = std::to_chars(text, text + sizeof text, value).ptr;
  return {text, end};
}

}  // namespace

std::string settings_text(const SimulationConfig& config, const Drive& drive) {
  std::string text = str("version: ", kWorldVersion, "\n");
  text += str("sensor: ", config.sensor == LidarModel::kHdl64 ? "hdl64" : "vlp16", "\n");
  if (drive.given_poses.empty()) {
    const char* names[] = {"loop", "opposite", "both"};
    text += str("route: ", names[static_cast<int>(config.route)],
                "\nlength: ", exact(config.length), "\n");
  } else {
    text +=
        str("poses: ", drive.poses.size(), " frames, fnv1a ", fingerprint(drive.given_poses), "\n");
  }
  text += str("calibration: fnv1a ", fingerprint(drive.calibration), "\n");
  text +=
      str("range-noise: ", exact(config.range_noise), "\ndropout: ", exact(config.dropout), "\n");
  text += str("seed: ", config.seed, "\n");
  return str(kHeader, text, "hash: ", fingerprint(text), "\n");
}

DataSet::DataSet(const SimulationConfig& config, std::string settings)
    : sequence_(config.output / "sequences" / config.sequence),
      velodyne_(sequence_ / "velodyne"),
      settings_file_(sequence_ / "simulation.txt"),
      poses_file_(config.output / "poses" / (config.sequence + ".txt")),
      settings_(std::move(settings)) {}

fs::path DataSet::scan_file(int frame) const {
  char name[24];
  std::snprintf(name, sizeof name, "%06d.bin", frame);
  return velodyne_ / name;
}

std::set<int> DataSet::scans_there() const {
  std::set<int> frames;
  std::error_code error;
  for (fs::directory_iterator it(velodyne_, error), end; !error && it != end; it.increment(error)) {
    const std::string name = it->path().filename().string();
    int frame = -1;
    std::from_chars(name.data(), name.data() + name.size(), frame);
    if (frame >= 0 && name == scan_file(frame).filename()) frames.insert(frame);
  }
  return frames;
}

/// The first line in which the settings there differ from ours.
std::string DataSet::difference() const {
  std::istringstream there(content(settings_file_)), ours(settings_);
  std::string a, b;
  while (std::getline(there, a) && std::getline(ours, b))
    if (a != b) return str("there '", a, "', now '", b, "'");
  return "they end differently";
}

std::set<int> DataSet::open(const std::set<int>& wanted, bool overwrite) {
  const std::string known = content(settings_file_);
  std::set<int> there = scans_there();
  if (known.empty()) {
    // Perhaps a real recording: never touched, whatever was asked for.
    for (const fs::path& file : {sequence_ / "calib.txt", sequence_ / "times.txt", poses_file_,
                                 there.empty() ? fs::path() : velodyne_})
      if (!file.empty() && fs::exists(file))
        throw UsageError(str(file.string(),
                             " is there already and was not made by `revisit simulate` (no ",
                             settings_file_.string(), "): choose another --output or --sequence"));
  } else if (!known.starts_with(kHeader)) {
    throw UsageError(
        settings_file_.string() +
        " is there but is no settings file of `revisit simulate`: choose another --output");
  } else if (known != settings_ && !overwrite) {
    throw UsageError(str(sequence_.string(), " holds ", there.size(),
                         " scans made with other settings (", difference(),
                         "): choose another --output or --sequence, or replace them with "
                         "--overwrite"));
  }
  // Scans that this run would not make: all of other settings, or frames not asked for.
  std::set<int> stale = there;
  if (known == settings_) {
    stale.clear();
    std::set_difference(there.begin(), there.end(), wanted.begin(), wanted.end(),
                        std::inserter(stale, stale.end()));
    if (!stale.empty() && !overwrite)
      throw UsageError(str(velodyne_.string(), " holds ", stale.size(),
                           " more scans than asked for (",
                           scan_file(*stale.begin()).filename().string(),
                           "): widen --frames or --every, choose another --output, or remove them "
                           "with --overwrite"));
  }
  for (const int frame : stale) {
    fs::remove(scan_file(frame));
    there.erase(frame);
  }
  make_folder(velodyne_);
  make_folder(poses_file_.parent_path());
  write_text(settings_file_, settings_);
  return there;
}

void DataSet::write_frame(const std::string& poses, const std::string& calibration,
                          const std::string& times) {
  write_text(poses_file_, poses);
  write_text(sequence_ / "calib.txt", calibration);
  write_text(sequence_ / "times.txt", times);
}

}  // namespace revisit::pipeline::simulation
