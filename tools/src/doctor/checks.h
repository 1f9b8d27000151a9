#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace revisit::doctor {

enum class Status { kOk, kWarn, kMissing };

/// "ok", "warn", "missing".
const char* to_string(Status status);

/// One line of `revisit doctor`.
struct Check {
  std::string section;  // program | machine | tools | models | data
  std::string name;
  Status status = Status::kOk;
  std::string found;
  std::string advice{};    // what to do; "" when nothing
  bool essential = false;  // kMissing here: the program cannot do its work
};
using Checks = std::vector<Check>;

// Each appends its lines and tolerates whatever it finds; none throws for what is missing.
void check_program(Checks& checks);  // build, the engine computing a small network correctly
void check_machine(Checks& checks);  // CPU, threads, BLAS, memory, disk
void check_tools(Checks& checks);    // terminal, gnuplot
void check_models(Checks& checks);   // the cache
void check_data(const std::filesystem::path& root,
                Checks& checks);  // a KITTI layout or scan folder

}  // namespace revisit::doctor
