#include <algorithm>
#include <fstream>
#include <optional>

#include "doctor/checks.h"
#include "revisit/pipeline/scan_file.h"
#include "revisit/proto/error.h"

namespace revisit::doctor {
namespace {

namespace fs = std::filesystem;

bool is_scan(const fs::path& file) {
  return pipeline::is_scan_file_name(file) && !file.filename().string().starts_with(".");
}

struct Scans {
  int count = 0;
  int empty = 0;        // files of 0 bytes: an interrupted copy
  int last_frame = -1;  // largest number among the file names
};

Scans count_scans(const fs::path& folder) {
  Scans scans;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    if (!is_scan(entry->path())) continue;
    ++scans.count;
    std::error_code none;
    if (fs::file_size(entry->path(), none) == 0 && !none) ++scans.empty;
    const std::string stem = entry->path().stem().string();
    if (!stem.empty() && stem.size() < 10 &&
        stem.find_first_not_of("0123456789") == std::string::npos)
      scans.last_frame = std::max(scans.last_frame, std::stoi(stem));
  }
  return scans;
}

int count_images(const fs::path& folder) {
  int images = 0;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error))
    images += entry->path().extension() == ".png";
  return images;
}

/// Lines that hold something, or nothing when there is no such file.
std::optional<int> count_lines(const fs::path& file) {
  std::ifstream in(file);
  if (!in || fs::is_directory(file)) return std::nullopt;
  int count = 0;
  for (std::string line; std::getline(in, line);)
    if (line.find_first_not_of(" \t\r") != std::string::npos) ++count;
  return count;
}

std::string plural(int count, const char* what) {
  return str(count, " ", what, count == 1 ? "" : "s");
}

/// "00" for "sequences/00", "sequences/00/" and, inside it, ".".
std::string folder_name(const fs::path& folder) {
  const fs::path path = fs::absolute(folder).lexically_normal();
  return (path.has_filename() ? path : path.parent_path()).filename().string();
}

struct Sequence {
  Check check;
  int n_scans = 0;
};

/// `folder` is sequences/NN; `poses` the candidates for its ground truth, best first.
Sequence check_sequence(const fs::path& folder, const std::vector<fs::path>& poses) {
  Check check{"data", "sequence " + folder_name(folder), Status::kOk, ""};
  const Scans scans = count_scans(folder / "velodyne");
  const std::optional<int> times = count_lines(folder / "times.txt");
  std::optional<int> n_poses;
  for (const fs::path& candidate : poses)
    if (!n_poses) n_poses = count_lines(candidate);

  check.found =
      str(plural(scans.count, "scan"), ", ", n_poses ? plural(*n_poses, "pose") : "no poses", ", ",
          times ? plural(*times, "time") : "no times");
  if (const int images = count_images(folder / "image_0"); images > 0)
    check.found += ", " + plural(images, "image");
  const auto warn = [&check](const std::string& advice) {
    check.status = Status::kWarn;
    check.advice += (check.advice.empty() ? "" : "; ") + advice;
  };
  if (scans.count == 0) warn(str("put the scans into ", (folder / "velodyne").string()));
  if (scans.empty > 0)
    warn(str(plural(scans.empty, "scan file"), " empty: copy the data set again"));
  if (!n_poses)
    warn(str("no ground truth (", poses[0].string(), "): evaluation is not possible"));
  else if (scans.last_frame >= *n_poses)
    warn(str("the scans go up to frame ", scans.last_frame, ", the poses only to ", *n_poses - 1));
  return {check, scans.count};
}

std::vector<fs::path> sorted_folders(const fs::path& root) {
  std::vector<fs::path> folders;
  std::error_code error;
  for (fs::directory_iterator entry(root, error), end; !error && entry != end;
       entry.increment(error))
    if (std::error_code none; entry->is_directory(none)) folders.push_back(entry->path());
  std::sort(folders.begin(), folders.end());
  return folders;
}

/// The sequences of a KITTI layout, or nothing when `root` is not one.
std::vector<Sequence> check_sequences(const fs::path& root) {
  std::vector<Sequence> sequences;
  std::error_code none;
  if (fs::is_directory(root / "sequences", none)) {
    for (const fs::path& folder : sorted_folders(root / "sequences"))
      sequences.push_back(check_sequence(
          folder, {root / "poses" / (folder_name(folder) + ".txt"), folder / "poses.txt"}));
  } else if (fs::is_directory(root / "velodyne", none)) {
    sequences.push_back(check_sequence(
        root, {root / "poses.txt", root / ".." / ".." / "poses" / (folder_name(root) + ".txt")}));
  }
  return sequences;
}

/// "7 places with 77 scans" when the folders of `root` hold scans, else "".
std::string places_in(const fs::path& root) {
  int places = 0, scans = 0;
  for (const fs::path& folder : sorted_folders(root))
    if (const int count = count_scans(folder).count; count > 0) ++places, scans += count;
  return places > 0 ? plural(places, "place") + " with " + plural(scans, "scan") : "";
}

/// The sets of places in the folders of `root`.
std::vector<Check> check_place_sets(const fs::path& root) {
  std::vector<Check> sets;
  for (const fs::path& folder : sorted_folders(root))
    if (const std::string places = places_in(folder); !places.empty())
      sets.push_back({"data", "set " + folder_name(folder), Status::kOk, places});
  return sets;
}

}  // namespace

void check_data(const fs::path& root, Checks& checks) {
  Check layout{"data", "layout", Status::kOk, root.string(), "", true};
  const auto miss = [&layout](const std::string& found, const std::string& advice) {
    layout.status = Status::kMissing;
    layout.found += found;
    layout.advice = advice;
  };
  std::vector<Sequence> sequences;
  std::vector<Check> sets;
  std::error_code none;
  if (!fs::is_directory(root, none)) {
    miss(fs::exists(root, none) ? " is not a folder" : " does not exist",
         "give the KITTI root (with sequences/ and poses/), a sequence, or a folder of scans");
  } else if (sequences = check_sequences(root); !sequences.empty()) {
    layout.found += ": KITTI odometry";
    if (std::none_of(sequences.begin(), sequences.end(),
                     [](const Sequence& sequence) { return sequence.n_scans > 0; }))
      miss(" without scans", "put them into sequences/NN/velodyne/000000.bin and on");
  } else if (const int count = count_scans(root).count; count > 0) {
    layout.found += ": folder of " + plural(count, "scan");
  } else if (const std::string places = places_in(root); !places.empty()) {
    layout.found += ": " + places;
  } else if (sets = check_place_sets(root); !sets.empty()) {
    layout.found += ": sets of places";
  } else {
    miss(": no scans",
         "expected sequences/NN/velodyne/*.bin, velodyne/*.bin, a folder of scans per place, or "
         "*.bin, *.pcd, *.ply");
  }
  checks.push_back(layout);
  for (const Sequence& sequence : sequences) checks.push_back(sequence.check);
  checks.insert(checks.end(), sets.begin(), sets.end());
}

}  // namespace revisit::doctor
