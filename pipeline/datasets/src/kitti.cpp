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

std::string listed(const std::vector<std::string>& names) {
  return names.empty() ? "none" : joined(names, ", ");
}

[[noreturn]] void fail_empty(const fs::path& root) {
  const std::vector<std::string> folders = list_names(root / "sequences", is_folder);
  std::string compressed;
  for (const std::string& name : folders)
    if (compressed.empty()) compressed = compressed_scans(root / "sequences" / name / "velodyne");
  throw InputError(root.string(), ": no sequence has scans: looked for ",
                   (root / "sequences" / "NN" / "velodyne" / "*.bin").string(),
                   ", .pcd and .ply; folders in sequences/: ", listed(folders), compressed);
}

}  // namespace

std::optional<fs::path> KittiSequence::poses() const {
  const auto found = std::find_if(pose_files.begin(), pose_files.end(), is_file);
  if (found == pose_files.end()) return {};
  return *found;
}

std::optional<KittiSequence> find_kitti_sequence(const fs::path& root,
                                                 const std::string& sequence) {
  std::error_code error;
  const fs::file_status status = fs::status(root, error);
  if (!fs::exists(status)) throw InputError(root.string(), ": ", error.message());
  if (!fs::is_directory(status)) throw InputError(root.string() + ": not a folder");

  if (is_folder(root / "sequences")) {
    const KittiSequence wanted = of_root(root, sequence);
    // If a sequence is named, the others (43,000 files of KITTI) are not listed.
    if (is_plain_name(sequence) && has_scans(wanted.folder)) return wanted;
    const std::vector<std::string> there = list_names(root / "sequences", has_scans);
    if (!sequence.empty())
      throw InputError(root.string(), ": sequence ", sequence, " has no scans: looked for ",
                       (wanted.velodyne() / "*.bin").string(),
                       nearest_name_hint(sequence.size() == 1 ? "0" + sequence : sequence, there),
                       "; sequences with scans: ", listed(there),
                       compressed_scans(wanted.velodyne()));
    if (there.size() == 1) return of_root(root, there[0]);
    if (there.empty()) fail_empty(root);
    throw InputError(root.string(),
                     ": several sequences, select one; sequences with scans: ", listed(there));
  }
  if (!is_folder(root / "velodyne")) return {};
  KittiSequence found = of_sequence_folder(root);
  if (!sequence.empty() && sequence != name_of(root))
    throw InputError(root.string(), ": this is one sequence's folder, so there is no sequence ",
                     sequence, " in it; pass the root above, or no sequence");
  return found;
}

}  // namespace revisit
