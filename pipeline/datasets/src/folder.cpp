#include "folder.h"

#include <algorithm>
#include <charconv>
#include <iterator>
#include <optional>
#include <string_view>

#include "io/file_content.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "revisit/datasets/scan_file.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;

/// strverscmp orders by runs of digits. It is 0 only for equal names, so the order is total.
bool naturally_less(const std::string& a, const std::string& b) {
  return ::strverscmp(a.c_str(), b.c_str()) < 0;
}

/// A link to nothing is one, too: its reader reports it, instead of a drive that lacks a scan.
bool is_visible_file(const fs::path& file) {
  std::error_code ignored;
  return !file.filename().string().starts_with(".") && !fs::is_directory(file, ignored);
}

bool is_scan(const fs::path& file) {
  return is_scan_file_name(file) && is_visible_file(file);
}

bool is_image(const fs::path& file) {
  return (file.extension() == ".png" || file.extension() == ".PNG") && is_visible_file(file);
}

template <class Take>
void each_entry_until(const fs::path& folder, const Take& take) {
  std::error_code error;
  if (!fs::is_directory(folder, error)) return;
  fs::directory_iterator entry(folder, error);
  for (; !error && entry != fs::directory_iterator(); entry.increment(error))
    if (take(entry->path())) return;
  if (error) throw InputError(folder.string(), ": cannot list: ", error.message());
}

bool is_compressed_scan(const fs::path& file) {
  constexpr std::string_view kKinds[] = {".gz", ".zip", ".xz", ".zst", ".bz2"};
  return std::ranges::find(kKinds, file.extension().string()) != std::end(kKinds) &&
         is_scan_file_name(file.stem()) && is_visible_file(file);
}

std::vector<NumberedFile> list_files(const fs::path& folder, bool (*keep)(const fs::path&),
                                     FrameNumbers numbers, const char* kind, const char* example) {
  const std::vector<std::string> names = list_names(folder, keep);
  if (names.empty())
    throw InputError(folder.string(), ": no ", kind, " in this folder", compressed_scans(folder));

  const auto unnumbered =
      std::ranges::find_if(names, [](const std::string& name) { return !number_in_name(name); });
  if (unnumbered != names.end() && numbers == FrameNumbers::kFromNames)
    throw InputError((folder / *unnumbered).string(),
                     ": expected the frame's number as the file name, e.g. ", example);

  std::vector<NumberedFile> files;
  for (const std::string& name : names) files.push_back({0, folder / name, time_in_name(name)});
  const auto has_time = [](const NumberedFile& file) { return file.time.has_value(); };
  if (std::ranges::all_of(files, has_time))
    std::ranges::stable_sort(files, {}, &NumberedFile::time);
  else
    for (NumberedFile& file : files) file.time.reset();
  for (size_t i = 0; i < files.size(); ++i)
    files[i].frame =
        unnumbered == names.end() ? *number_in_name(files[i].file) : static_cast<int>(i);
  std::ranges::stable_sort(files, {}, &NumberedFile::frame);
  const auto twice = std::ranges::adjacent_find(files, {}, &NumberedFile::frame);
  if (twice != files.end())
    throw InputError(folder.string(), ": frame ", twice->frame,
                     " appears twice: ", twice->file.filename().string(), " and ",
                     std::next(twice)->file.filename().string());
  return files;
}

bool is_visible_folder(const fs::path& path) {
  std::error_code ignored;
  return !path.filename().string().starts_with(".") && fs::is_directory(path, ignored);
}
bool is_place(const fs::path& path) {
  return is_visible_folder(path) && holds_scans(path);
}
bool is_set(const fs::path& path) {
  return is_visible_folder(path) && holds(path, is_place);
}

}  // namespace

std::optional<int> number_in_name(const fs::path& file) {
  const std::string stem = file.stem().string();
  if (stem.empty() || stem.find_first_not_of("0123456789") != std::string::npos) return {};
  int number = 0;
  const auto [stop, error] = std::from_chars(stem.data(), stem.data() + stem.size(), number);
  if (error != std::errc()) return {};
  return number;
}

std::optional<double> time_in_name(const fs::path& file) {
  const std::string stem = file.stem().string();
  const size_t mark = stem.find_first_of("_.");
  const std::string seconds = stem.substr(0, mark),
                    rest = mark == std::string::npos ? "" : stem.substr(mark + 1);
  const auto is_number = [](const std::string& text) {
    return !text.empty() && text.size() <= 19 &&
           text.find_first_not_of("0123456789") == std::string::npos;
  };
  const auto value_of = [](const std::string& text) { return parse_number(text, "a time", false); };
  if (!is_number(seconds)) return {};
  if (mark == std::string::npos) {  // leading zeros: a frame number
    if ((seconds.size() != 16 && seconds.size() != 19) || seconds.front() == '0') return {};
    return value_of(seconds) * (seconds.size() == 16 ? 1e-6 : 1e-9);
  }
  if (!is_number(rest) || seconds.size() > 10) return {};
  if (stem[mark] == '.') return value_of(stem);
  // Shorter numbers have another meaning, such as a date and an index.
  if (seconds.size() < 9 || rest.size() < 6 || rest.size() > 9) return {};
  return value_of(seconds) + value_of(rest) * 1e-9;
}

std::vector<std::string> list_names(const fs::path& folder, bool (*keep)(const fs::path&)) {
  std::vector<std::string> names;
  each_entry_until(folder, [&](const fs::path& path) {
    if (keep(path)) names.push_back(path.filename().string());
    return false;
  });
  std::sort(names.begin(), names.end(), naturally_less);
  return names;
}

bool holds(const fs::path& folder, bool (*wanted)(const fs::path&)) {
  bool found = false;
  each_entry_until(folder, [&](const fs::path& path) { return found = wanted(path); });
  return found;
}

bool holds_scans(const fs::path& folder) {
  return holds(folder, is_scan);
}

std::string compressed_scans(const fs::path& folder) {
  const std::vector<std::string> names = list_names(folder, is_compressed_scan);
  return names.empty() ? ""
                       : str("; ", folder.string(), " has ", names.size(), " compressed ones (",
                             names.front(), "): unpack them first");
}

std::vector<NumberedFile> list_scans(const fs::path& folder, FrameNumbers numbers) {
  return list_files(folder, is_scan, numbers, "scans (.bin, .pcd or .ply)", "000123.bin");
}

std::vector<NumberedFile> list_images(const fs::path& folder) {
  return list_files(folder, is_image, FrameNumbers::kFromNames, "images (.png)", "000123.png");
}

PlaceFolders find_places(const fs::path& root, const std::string& sequence) {
  PlaceFolders found;
  found.name = fs::canonical(root).filename().string();
  fs::path folder = root;
  std::vector<std::string> names;
  if (sequence.empty()) names = list_names(root, is_place);
  if (names.empty()) {
    const std::vector<std::string> sets = list_names(root, is_set);
    if (sets.empty()) return found;
    const std::string list = joined(sets, ", ");
    if (!sequence.empty() && std::find(sets.begin(), sets.end(), sequence) == sets.end())
      throw InputError(root.string(), ": there is no set of places '", sequence, "'",
                       nearest_name_hint(sequence, sets), "; sets with a folder per place: ", list);
    if (sequence.empty() && sets.size() > 1)
      throw InputError(
          root.string(),
          ": several sets of places, select one (as the sequence); sets with a folder per place: ",
          list);
    found.sequence = sequence.empty() ? sets[0] : sequence;
    folder = root / found.sequence;
    names = list_names(folder, is_place);
  }
  for (const std::string& name : names) found.places.push_back(folder / name);
  return found;
}

}  // namespace revisit
