#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace revisit::doctor {

struct Status {
  static constexpr const char *kOk = "ok", *kWarn = "warn", *kMissing = "missing";
};

struct Check {
  std::string section;  // program | machine | models | data
  std::string name;
  std::string status = Status::kOk;
  std::string found;
  std::string advice{};
  bool essential = false;  // the program cannot work if this is kMissing
};
using Checks = std::vector<Check>;

// None throws if something is missing.
void check_program(Checks& checks);
void check_machine(Checks& checks);
void check_models(Checks& checks);
/// `root`: anything that open_dataset() opens.
void check_data(const std::filesystem::path& root, Checks& checks);

}  // namespace revisit::doctor
