#include "cli/renamed.h"

#include <sstream>

#include "cli/messages.h"
#include "revisit/base/error.h"

namespace revisit::cli {
namespace {

constexpr Renamed kOptions[] = {
    {"against", "baseline"},
    {"alter", "perturb"},
    {"altered", "augment"},
    {"among", "distractors"},
    {"basis", "basis-from"},
    {"column-scans", "cnn-scans"},
    {"columns-share", "cnn-weight"},
    {"first-stretch", "warmup", "revisit eval,revisit loops,revisit map build"},
    {"graph-candidates", "hnsw-candidates"},
    {"gray", "single-channel"},
    {"judge", "evaluate"},
    {"numbers", "dtype"},
    {"other-beyond", "negative-radius"},
    {"page", "output", "revisit report"},
    {"pca-fit", "fit-on"},
    {"right-share", "match-prior"},
    {"ring-adapt", "ring-blend"},
    {"ring-key-candidates", "candidates"},
    {"ring-numbers", "ring-dim"},
    {"sure", "target-precision"},
};

constexpr Renamed kValues[] = {{"usual", "default", "accuracy"}};

constexpr Renamed kCommands[] = {
    {"forget", "prune", "revisit map"},
    {"learn", "train", "revisit"},
};

bool belongs(const Renamed& option, const std::string& command) {
  std::istringstream commands{std::string(option.where)};
  for (std::string one; std::getline(commands, one, ',');)
    if (one == command) return true;
  return option.where.empty();
}

std::string current(std::span<const Renamed> table, const std::string& where,
                    const std::string& name) {
  for (const Renamed& one : table)
    if (one.where == where && one.former == name) return std::string(one.now);
  return name;
}

}  // namespace

std::span<const Renamed> renamed_options() {
  return kOptions;
}
std::span<const Renamed> renamed_values() {
  return kValues;
}
std::span<const Renamed> renamed_commands() {
  return kCommands;
}

std::vector<std::string> former_options(const std::string& command, const std::string& option) {
  std::vector<std::string> names;
  for (const Renamed& one : kOptions)
    if (one.now == option && belongs(one, command)) names.emplace_back(one.former);
  return names;
}

std::string current_option(const std::string& command, const std::string& name) {
  for (const Renamed& one : kOptions)
    if (one.former == name && belongs(one, command)) return std::string(one.now);
  return name;
}

std::string current_value(const std::string& option, const std::string& value) {
  return current(kValues, option, value);
}

std::string current_command(const std::string& program, const std::string& name) {
  return current(kCommands, program, name);
}

void warn_deprecated(const std::string& former, const std::string& now) {
  warn(str(former, " is deprecated, use ", now));
}

}  // namespace revisit::cli
