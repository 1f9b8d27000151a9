#include <map>

#include "folder.h"
#include "revisit/base/error.h"
#include "revisit/datasets/dataset.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;

fs::path kitti_images(const Dataset& dataset) {
  const fs::path scans = dataset.scans.empty() ? "" : dataset.scans[0].file.parent_path();
  if (scans.filename() != "velodyne")
    throw InputError(scans.string(),
                     ": not a KITTI sequence; pass the folder of its camera images (frame numbers "
                     "as names, e.g. 000123.png)");
  return scans.parent_path() / "image_0";
}

}  // namespace

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
