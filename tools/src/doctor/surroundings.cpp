#include <unistd.h>

#include <cstdlib>
#include <sstream>

#include "cli/messages.h"
#include "doctor/checks.h"
#include "models/cache.h"
#include "models/fetch.h"
#include "revisit/proto/error.h"

namespace revisit::doctor {
namespace {

namespace fs = std::filesystem;

/// Where the shell would find `program`, or "".
fs::path find_in_path(const std::string& program) {
  const char* const path = std::getenv("PATH");
  std::istringstream folders(path ? path : "");
  for (std::string folder; std::getline(folders, folder, ':');) {
    const fs::path candidate = fs::path(folder) / program;
    std::error_code none;
    if (fs::is_regular_file(candidate, none) && ::access(candidate.c_str(), X_OK) == 0)
      return candidate;
  }
  return {};
}

void check_terminal(Checks& checks) {
  const char* const term = std::getenv("TERM");
  std::string found =
      str(isatty(STDERR_FILENO) ? "progress is shown" : "not a terminal: no progress line",
          term ? str(", TERM=", term) : "");
  if (std::getenv("NO_COLOR")) found += ", NO_COLOR set";
  checks.push_back({"tools", "terminal", Status::kOk, found});
}

}  // namespace

void check_tools(Checks& checks) {
  check_terminal(checks);
  if (const fs::path gnuplot = find_in_path("gnuplot"); !gnuplot.empty())
    checks.push_back({"tools", "gnuplot", Status::kOk, gnuplot.string()});
  else
    checks.push_back({"tools", "gnuplot", Status::kWarn, "not found",
                      "for plots: apt-get install gnuplot-nox (everything else works without)"});
}

void check_models(Checks& checks) {
  fs::path cache;
  try {
    cache = models::cache_folder();
  } catch (const Error& error) {
    checks.push_back({"models", "cache", Status::kWarn, "no place", error.what()});
    return;
  }
  bool any = false;
  const auto loose = models::loose_weights(cache);
  for (const models::KnownModel& model : models::known_models()) {
    Check check{"models", model.name, Status::kOk, ""};
    try {
      const models::CacheEntry entry = models::inspect(cache, model, loose);
      if (entry.state == models::CacheState::kAbsent) continue;
      check.found = str(models::to_string(entry.state), ", ", entry.file.string());
      any |= entry.state == models::CacheState::kVerified ||
             entry.state == models::CacheState::kUnverified;
      if (entry.state == models::CacheState::kPartial) {
        check.status = Status::kWarn;
        check.advice = str("'revisit models fetch ", model.name, "' gets the rest");
      } else if (entry.state == models::CacheState::kWrong) {
        check.status = Status::kWarn;
        check.advice = "remove it; " + models::how_to_get(model, cache);
      }
    } catch (const std::exception& error) {
      check.status = Status::kWarn;
      check.found = cli::in_our_words(error.what());
    }
    checks.push_back(check);
  }
  if (!any)
    checks.push_back({"models", "trained network", Status::kMissing,
                      str("none in ", cache.string()),
                      "'revisit models fetch bvlc_alexnet', or give --model and --weights; to try "
                      "the machinery: 'revisit models make-random -o DIR'"});
}

}  // namespace revisit::doctor
