#include <algorithm>

#include "folder.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "revisit/datasets/dataset.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;

bool is_folder(const fs::path& path) {
  std::error_code ignored;
  return fs::is_directory(path, ignored);
}

bool is_file(const fs::path& path) {
  std::error_code ignored;
  return fs::is_regular_file(path, ignored);
}

bool is_text(const fs::path& path) {
  return path.extension() == ".txt" && is_file(path);
}
bool has_scans(const fs::path& path) {
  return holds_scans(path / "velodyne");
}

bool is_plain_name(const std::string& name) {
  return !name.empty() && name != "." && name != ".." && name.find('/') == std::string::npos;
}

/// Resolves "." and "data/".
std::string name_of(const fs::path& folder) {
  std::error_code ignored;
  const fs::path real = fs::canonical(folder, ignored);
  return real.filename().string();
}

KittiSequence of_root(const fs::path& root, const std::string& sequence) {
  const fs::path folder = root / "sequences" / sequence;
  return {name_of(root),
          sequence,
          folder,
          {root / "poses" / (sequence + ".txt"), folder / "poses.txt"}};
}

/// Inside a KITTI root, the folder's name is the sequence's number.
KittiSequence of_sequence_folder(const fs::path& folder) {
  std::error_code ignored;
  const fs::path real = fs::canonical(folder, ignored);
  const fs::path root = real.parent_path().parent_path();
  const fs::path numbered_poses = root / "poses" / (real.filename().string() + ".txt");
  if (real.parent_path().filename() != "sequences")
    return {real.filename().string(), "", folder, {folder / "poses.txt", numbered_poses}};
  return {root.filename().string(),
          real.filename().string(),
          folder,
          {folder / "poses.txt", numbered_poses}};
}

std::vector<std::string> sequences_with_poses(const fs::path& root) {
  std::vector<std::string> names = list_names(root / "poses", is_text);
  for (std::string& name : names) name.resize(name.size() - std::string(".txt").size());
  for (std::string& name : list_names(root / "sequences", is_folder))
    if (is_file(root / "sequences" / name / "poses.txt") &&
        std::find(names.begin(), names.end(), name) == names.end())
      names.push_back(std::move(name));
  return names;
}

std::string listed(const std::vector<std::string>& names) {
  return names.empty() ? "none" : joined(names, ", ");
}

[[noreturn]] void fail_empty(const fs::path& root, bool for_poses) {
  const std::vector<std::string> folders = list_names(root / "sequences", is_folder);
  std::string compressed;
  for (const std::string& name : folders)
    if (!for_poses && compressed.empty())
      compressed = compressed_scans(root / "sequences" / name / "velodyne");
  throw InputError(
      root.string(), ": no sequence has ", for_poses ? "poses" : "scans", ": looked for ",
      for_poses ? (root / "poses" / "NN.txt").string() + " and " +
                      (root / "sequences" / "NN" / "poses.txt").string()
                : (root / "sequences" / "NN" / "velodyne" / "*.bin").string() + ", .pcd and .ply",
      "; folders in sequences/: ", listed(folders), compressed);
}

}  // namespace

std::optional<fs::path> KittiSequence::poses() const {
  const auto found = std::find_if(pose_files.begin(), pose_files.end(), is_file);
  if (found == pose_files.end()) return {};
  return *found;
}

std::optional<KittiSequence> find_kitti_sequence(const fs::path& root, const std::string& sequence,
                                                 bool for_poses) {
  std::error_code error;
  const fs::file_status status = fs::status(root, error);
  if (!fs::exists(status)) throw InputError(root.string(), ": ", error.message());
  if (!fs::is_directory(status)) throw InputError(root.string() + ": not a folder");

  if (is_folder(root / "sequences") || (for_poses && is_folder(root / "poses"))) {
    const KittiSequence wanted = of_root(root, sequence);
    // If a sequence is named, the others (43,000 files of KITTI) are not listed.
    if (is_plain_name(sequence) &&
        (for_poses ? wanted.poses().has_value() : has_scans(wanted.folder)))
      return wanted;
    const std::vector<std::string> there =
        for_poses ? sequences_with_poses(root) : list_names(root / "sequences", has_scans);
    const char* const what = for_poses ? "poses" : "scans";
    if (!sequence.empty())
      throw InputError(
          str(root.string(), ": sequence ", sequence, " has no ", what, ": looked for ",
              for_poses ? wanted.pose_files[0].string() + " and " + wanted.pose_files[1].string()
                        : (wanted.velodyne() / "*.bin").string(),
              nearest_name_hint(sequence.size() == 1 ? "0" + sequence : sequence, there),
              "; sequences with ", what, ": ", listed(there),
              for_poses ? "" : compressed_scans(wanted.velodyne())));
    if (there.size() == 1) return of_root(root, there[0]);
    if (there.empty()) fail_empty(root, for_poses);
    throw InputError(root.string(), ": several sequences, select one; sequences with ", what, ": ",
                     listed(there));
  }
  if (!is_folder(root / "velodyne") && !(for_poses && is_file(root / "poses.txt"))) return {};
  KittiSequence found = of_sequence_folder(root);
  if (!sequence.empty() && sequence != name_of(root))
    throw InputError(root.string(), ": this is one sequence's folder, so there is no sequence ",
                     sequence, " in it; pass the root above, or no sequence");
  return found;
}

fs::path find_kitti_poses(const fs::path& root, const std::string& sequence) {
  const std::optional<KittiSequence> found = find_kitti_sequence(root, sequence, true);
  if (!found)
    throw InputError(root.string(), ": no KITTI poses here: looked for ",
                     (root / "poses" / "NN.txt").string(), ", ",
                     (root / "sequences" / "NN" / "poses.txt").string(), " and ",
                     (root / "poses.txt").string());
  if (const auto file = found->poses()) return *file;
  throw InputError(root.string(), ": no poses: looked for ", found->pose_files[0].string(), " and ",
                   found->pose_files[1].string());
}

}  // namespace revisit
