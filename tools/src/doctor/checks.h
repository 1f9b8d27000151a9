#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace revisit::doctor {

struct Status {
  static constexpr const char *kOk = "ok", *kWarn = "warn", *kMissing = "missing";
};

/// One line of `revisit doctor`.
struct Check {
  std::string section;  // program | machine | models | data
  std::string name;
  std::string status = Status::kOk;
  std::string found;
  std::string advice{};    // how to fix it, or ""
  bool essential = false;  // the program cannot work if this is kMissing
};
using Checks = std::vector<Check>;

// Each appends its lines. None throws if something is missing.
void check_program(Checks& checks);  // build, the engine computing a small network correctly
void check_machine(Checks& checks);  // CPU, threads, BLAS, memory, disk, terminal
void check_models(Checks& checks);   // the cache
void check_data(const std::filesystem::path& root,
                Checks& checks);  // anything that open_dataset() opens

}  // namespace revisit::doctor
