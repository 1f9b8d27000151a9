#include <algorithm>

#include "doctor/checks.h"
#include "revisit/base/error.h"
#include "revisit/datasets/dataset.h"

namespace revisit::doctor {
namespace {

namespace fs = std::filesystem;

std::string plural(int64_t count, const char* what) {
  return str(count, " ", what, count == 1 ? "" : "s");
}

void warn(Check& check, const std::string& advice) {
  check.status = Status::kWarn;
  check.advice += (check.advice.empty() ? "" : "; ") + advice;
}

/// "7 places with 77 scans", or "12 scans, 4541 poses, no times".
std::string content_of(const Dataset& data) {
  const std::string scans = plural(static_cast<int64_t>(data.scans.size()), "scan");
  if (data.has_places()) {
    int64_t places = 0;
    for (size_t i = 0; i < data.scans.size(); ++i)
      places += i == 0 || data.scans[i].place != data.scans[i - 1].place;
    return plural(places, "place") + " with " + scans;
  }
  return str(scans, ", ", data.n_poses ? plural(data.n_poses, "pose") : "no poses", ", ",
             data.scans[0].time ? "times" : "no times");
}

Check check_of(const fs::path& root, const std::string& sequence) {
  const Dataset data = open_dataset(root, sequence);
  const std::string name = data.sequence.empty() ? "scans"
                           : data.has_places()   ? "set " + data.sequence
                                                 : "sequence " + data.sequence;
  Check check{"data", name, Status::kOk, content_of(data)};
  for (const std::string& warning : data.warnings) warn(check, warning);
  const auto empty = std::ranges::count_if(data.scans, [](const ScanRef& scan) {
    std::error_code error;
    return fs::file_size(scan.file, error) == 0 && !error;
  });
  if (empty > 0) warn(check, plural(empty, "scan file") + " empty; copy the data set again");
  if (data.has_places() || data.sequence.empty()) return check;
  if (!data.has_poses()) warn(check, "no ground truth, so evaluation is not possible");
  const fs::path images = data.scans[0].file.parent_path().parent_path() / "image_0";
  if (std::error_code none; fs::is_directory(images, none)) try {
      check.found += ", " + plural(static_cast<int64_t>(camera_images(data).scans.size()), "image");
    } catch (const InputError& error) {
      warn(check, error.what());
    }
  return check;
}

std::vector<std::string> folders_in(const fs::path& root) {
  std::vector<std::string> names;
  std::error_code error;
  for (fs::directory_iterator entry(root, error), end; !error && entry != end;
       entry.increment(error))
    if (std::error_code none; entry->is_directory(none))
      names.push_back(entry->path().filename().string());
  std::ranges::sort(names);
  return names;
}

}  // namespace

void check_data(const fs::path& root, Checks& checks) {
  std::error_code none;
  const bool kitti = fs::is_directory(root / "sequences", none);
  Checks found;
  bool any_usable = false;
  std::string problem =
      "no usable sequence; put scans into sequences/NN/velodyne/000000.bin and on";
  if (!kitti) try {
      found.push_back(check_of(root, ""));
      any_usable = true;
    } catch (const InputError& error) {
      problem = error.what();
    }
  // Sequences of KITTI, any of which may be missing, or sets of places.
  if (!any_usable)
    for (const std::string& name : folders_in(kitti ? root / "sequences" : root)) try {
        found.push_back(check_of(root, name));
        any_usable = true;
      } catch (const InputError& error) {
        if (kitti)
          found.push_back({"data", "sequence " + name, Status::kWarn, "unusable", error.what()});
      }
  checks.push_back({"data", "layout", any_usable ? Status::kOk : Status::kMissing, root.string(),
                    any_usable ? "" : problem, true});
  checks.insert(checks.end(), found.begin(), found.end());
}

}  // namespace revisit::doctor
