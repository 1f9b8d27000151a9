#include "output_folder.h"

#include <algorithm>
#include <sstream>

#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/base/hash.h"

namespace revisit::simulation {
namespace {

namespace fs = std::filesystem;

constexpr CppName kOverwrite{"SimulationConfig::overwrite"};
constexpr const char* kHeader = "# revisit simulate: the settings of the scans beside this file\n";

}  // namespace

OutputFolder::OutputFolder(fs::path settings_file, const std::string& settings)
    : settings_file_(std::move(settings_file)),
      settings_(str(kHeader, settings, "hash: ", short_name_of(settings), "\n")) {}

std::string OutputFolder::difference(const std::string& known) const {
  std::istringstream there(known), ours(settings_);
  std::string a, b;
  while (std::getline(there, a) && std::getline(ours, b))
    if (a != b) return str("there '", a, "', now '", b, "'");
  return "they end differently";
}

OutputFolder::Files OutputFolder::open(const Files& wanted, const Files& there,
                                       const std::vector<fs::path>& others, bool overwrite) const {
  const std::string known = content_if_any(settings_file_);
  const std::string folder = settings_file_.parent_path().string();
  if (known.empty()) {
    // These may be real recordings, so they are never touched, whatever the options.
    std::vector<fs::path> strange = others;
    if (!there.empty()) strange.push_back(*there.begin());
    for (const fs::path& file : strange)
      if (fs::exists(file))
        throw UsageError(file.string(), " already exists and was not made by a simulation (no ",
                         settings_file_.string(), "): choose another output or sequence");
  } else if (!known.starts_with(kHeader)) {
    throw UsageError(settings_file_.string() +
                     " exists but is not a settings file of a simulation: choose another output");
  } else if (known != settings_ && !overwrite) {
    throw UsageError(folder, " holds ", there.size(), " files made with other settings (",
                     difference(known), "): choose another output or sequence, or replace them (",
                     kOverwrite, ")");
  }
  // Files that this run would not write: all files of other settings, or unrequested ones.
  Files stale = there;
  if (known == settings_) {
    stale.clear();
    std::set_difference(there.begin(), there.end(), wanted.begin(), wanted.end(),
                        std::inserter(stale, stale.end()));
    if (!stale.empty() && !overwrite)
      throw UsageError(folder, " holds ", stale.size(), " more files than requested (",
                       stale.begin()->filename().string(),
                       "): request more frames, choose another output, or remove them (",
                       kOverwrite, ")");
  }
  for (const fs::path& file : stale) {
    std::error_code error;
    fs::remove(file, error);
    if (error) throw Error("cannot remove ", file.string(), ": ", error.message());
  }
  Files complete;
  for (const fs::path& file : wanted) {
    make_folder(file.parent_path());
    if (there.contains(file) && !stale.contains(file)) complete.insert(file);
  }
  write_text(settings_file_, settings_);
  return complete;
}

void write_text(const fs::path& file, const std::string& text) {
  if (content_if_any(file) == text) return;
  make_folder(file.parent_path());
  write_atomically(file, [&](std::ostream& out) { out << text; });
}

}  // namespace revisit::simulation
