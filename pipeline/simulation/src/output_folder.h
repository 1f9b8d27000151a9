#pragma once

#include <filesystem>
#include <set>
#include <string>
#include <vector>

namespace revisit::pipeline::simulation {

/// The folder that one simulation fills, and in which nothing else may be.
class OutputFolder {
 public:
  using Files = std::set<std::filesystem::path>;

  /// `settings` (lines `key: value`) identifies the simulation; `settings_file` keeps it.
  OutputFolder(std::filesystem::path settings_file, const std::string& settings);

  /// Makes the folder ready for the files `wanted`: `there` are those of their kind now, `others`
  /// will be written besides. Throws UsageError for files that are not ours or of other settings,
  /// removes the latter with `overwrite`, and writes the settings. Returns the wanted ones there.
  Files open(const Files& wanted, const Files& there,
             const std::vector<std::filesystem::path>& others, bool overwrite) const;

 private:
  std::string difference(const std::string& known) const;

  std::filesystem::path settings_file_;
  std::string settings_;
};

/// Writes the file unless it already has this content, and the folders above it.
void write_text(const std::filesystem::path& file, const std::string& text);

}  // namespace revisit::pipeline::simulation
