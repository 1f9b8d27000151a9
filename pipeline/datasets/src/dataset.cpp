#include "revisit/datasets/dataset.h"

#include <map>

#include "folder.h"
#include "revisit/base/error.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void fail_missing(const fs::path& root, const char* what, const std::string& places) {
  throw InputError(root.string(), ": no ", what, ", which are required: looked for ", places);
}

void add_poses(const KittiSequence& sequence, bool needed, Dataset* dataset) {
  const std::optional<fs::path> file = sequence.poses();
  if (!file) {
    if (needed)
      fail_missing(sequence.folder, "poses",
                   str(sequence.pose_files[0].string(), " and ", sequence.pose_files[1].string()));
    return;
  }
  const std::vector<Pose> poses = read_kitti_poses(*file);
  if (const ScanRef& last = dataset->scans.back(); static_cast<size_t>(last.frame) >= poses.size())
    throw InputError(file->string(), ": holds ", poses.size(), " poses (frames 0 to ",
                     poses.size() - 1, "), but ", last.file.string(), " is frame ", last.frame);
  dataset->n_poses = static_cast<int64_t>(poses.size());
  dataset->camera_axes = true;
  for (ScanRef& scan : dataset->scans) scan.pose = poses[static_cast<size_t>(scan.frame)];
}

void add_times(const KittiSequence& sequence, Dataset* dataset) {
  const fs::path file = sequence.folder / "times.txt";
  std::error_code ignored;
  if (!fs::exists(file, ignored)) return;
  const std::vector<double> times = read_kitti_times(file);
  const auto n_times = static_cast<int64_t>(times.size());
  if (dataset->n_poses > 0 && dataset->n_poses < n_times)
    dataset->warnings.push_back(str(
        sequence.poses()->string(), ": holds ", dataset->n_poses, " poses where ", file.string(),
        " holds ", n_times,
        " times; if a line of poses is missing, all later scans have the pose of the next frame"));
  const ScanRef& last = dataset->scans.back();
  if (last.frame >= n_times) {
    dataset->warnings.push_back(str(file.string(), ": holds ", n_times, " times (frames 0 to ",
                                    n_times - 1, "), but ", last.file.string(), " is frame ",
                                    last.frame, "; no times are used"));
    return;
  }
  for (ScanRef& scan : dataset->scans) scan.time = times[static_cast<size_t>(scan.frame)];
}

std::vector<ScanRef> scan_refs(const fs::path& folder, FrameNumbers numbers) {
  std::vector<ScanRef> scans;
  for (NumberedFile& scan : list_scans(folder, numbers))
    scans.push_back({std::move(scan.file), scan.frame, {}, scan.time, ""});
  return scans;
}

Dataset by_place(const PlaceFolders& folders) {
  Dataset dataset;
  dataset.name = folders.name;
  dataset.sequence = folders.sequence;
  for (const fs::path& place : folders.places)
    for (NumberedFile& scan : list_scans(place, FrameNumbers::kFromNamesOrOrder))
      dataset.scans.push_back({std::move(scan.file),
                               static_cast<int>(dataset.scans.size()),
                               {},
                               {},
                               place.filename().string()});
  return dataset;
}

fs::path kitti_images(const Dataset& dataset) {
  const fs::path scans = dataset.scans.empty() ? "" : dataset.scans[0].file.parent_path();
  if (scans.filename() != "velodyne")
    throw InputError(scans.string(),
                     ": not a KITTI sequence; pass the folder of its camera images (frame numbers "
                     "as names, e.g. 000123.png)");
  return scans.parent_path() / "image_0";
}

}  // namespace

Dataset open_dataset(const fs::path& root, const std::string& sequence, bool needs_poses) {
  Dataset dataset;
  if (const auto found = find_kitti_sequence(root, sequence)) {
    dataset.name = found->name;
    dataset.sequence = found->sequence;
    dataset.scans = scan_refs(found->velodyne(), FrameNumbers::kFromNames);
    add_poses(*found, needs_poses, &dataset);
    add_times(*found, &dataset);
    return dataset;
  }

  const bool plain = holds_scans(root);
  const PlaceFolders sorted = plain ? PlaceFolders{} : find_places(root, sequence);
  if (!plain && sorted.places.empty())
    throw InputError(
        root.string(), ": no scans here: looked for ",
        (root / "sequences" / "NN" / "velodyne").string(), ", ", (root / "velodyne").string(),
        ", for .bin, .pcd or .ply files in the folder itself and in a folder per place",
        compressed_scans(root));
  if (plain && !sequence.empty())
    throw InputError(root.string(), ": a plain folder of scans has no sequence ", sequence,
                     ": looked for ", (root / "sequences" / sequence).string());
  if (needs_poses)
    fail_missing(
        root, "poses",
        str("the KITTI layout (sequences/NN/velodyne with poses/NN.txt, or velodyne/ with "
            "poses.txt); a ",
            plain ? "plain folder of scans has none"
                  : "folder per place has none: use a protocol of named places, e.g. places-3"));
  if (!plain) return by_place(sorted);
  dataset.name = fs::canonical(root).filename().string();
  dataset.scans = scan_refs(root, FrameNumbers::kFromNamesOrOrder);
  return dataset;
}

Dataset image_folder(const fs::path& folder) {
  std::error_code ignored;
  if (!fs::is_directory(folder, ignored))
    throw InputError(folder.string() + ": no such folder of camera images");
  Dataset images;
  images.name = fs::canonical(folder).filename().string();
  for (NumberedFile& image : list_images(folder))
    images.scans.push_back({std::move(image.file), image.frame, {}, {}});
  return images;
}

Dataset camera_images(const Dataset& dataset, const fs::path& folder) {
  const fs::path images = folder.empty() ? kitti_images(dataset) : folder;
  std::map<int, fs::path> by_frame;
  for (ScanRef& image : image_folder(images).scans) by_frame[image.frame] = std::move(image.file);

  Dataset result = dataset;
  for (ScanRef& scan : result.scans) {
    const auto image = by_frame.find(scan.frame);
    if (image == by_frame.end())
      throw InputError(images.string(), ": no image of frame ", scan.frame, ", which has the scan ",
                       scan.file.string(), "; there are ", by_frame.size(), " images, frames ",
                       by_frame.begin()->first, " to ", by_frame.rbegin()->first);
    scan.file = image->second;
  }
  return result;
}

}  // namespace revisit
