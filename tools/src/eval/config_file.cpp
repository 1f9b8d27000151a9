#include "config_file.h"

#include <yaml-cpp/yaml.h>

#include "revisit/base/error.h"
#include "revisit/base/files.h"

namespace revisit::cli {
namespace {

[[noreturn]] void fail(const std::filesystem::path& file, const YAML::Mark& mark,
                       const std::string& reason) {
  throw InputError(file.string(), ":", mark.line + 1, ":", mark.column + 1, ": ", reason);
}

}  // namespace

std::vector<std::pair<std::string, std::string>> read_config_file(
    const std::filesystem::path& file) {
  YAML::Node root;
  try {
    root = YAML::Load(read_content(file));
  } catch (const YAML::ParserException& error) {
    fail(file, error.mark, error.msg);
  }
  std::vector<std::pair<std::string, std::string>> values;
  if (root.IsNull()) return values;
  if (!root.IsMap()) fail(file, root.Mark(), "expected a map of option names and values");
  for (const auto& entry : root) {
    if (!entry.first.IsScalar()) fail(file, entry.first.Mark(), "expected an option's name");
    const std::string& name = entry.first.Scalar();
    const YAML::Node& value = entry.second;
    if (value.IsScalar()) {
      values.emplace_back(name, value.Scalar());
    } else if (value.IsSequence()) {
      for (const YAML::Node& item : value) {
        if (!item.IsScalar()) fail(file, item.Mark(), "expected a value for '" + name + "'");
        values.emplace_back(name, item.Scalar());
      }
    } else if (!value.IsNull()) {
      fail(file, value.Mark(), "expected a value or a list of values for '" + name + "'");
    }
  }
  return values;
}

}  // namespace revisit::cli
