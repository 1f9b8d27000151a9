#pragma once

#include <filesystem>
#include <set>
#include <string>
#include <vector>

namespace revisit::simulation {

/// Holds one simulation and no other files.
class OutputFolder {
 public:
  using Files = std::set<std::filesystem::path>;

  /// `settings` (lines `key: value`) identifies the simulation; `settings_file` keeps it.
  OutputFolder(std::filesystem::path settings_file, const std::string& settings);

  /// `there` are the existing files of the kind of `wanted`; `others` will be written, too. Throws
  /// UsageError for foreign files and for files of other settings; with `overwrite`, removes the
  /// latter. Writes the settings. Returns the wanted files that exist.
  Files open(const Files& wanted, const Files& there,
             const std::vector<std::filesystem::path>& others, bool overwrite) const;

 private:
  std::string difference(const std::string& known) const;

  std::filesystem::path settings_file_;
  std::string settings_;
};

/// Writes the file and its parent folders, unless it already has this content.
void write_text(const std::filesystem::path& file, const std::string& text);

}  // namespace revisit::simulation
