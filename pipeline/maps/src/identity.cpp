#include "identity.h"

#include <sstream>

#include "revisit/base/error.h"

namespace revisit {

std::string text_of(const MapFingerprint& identity) {
  std::string text;
  for (const auto& [name, value] : identity) {
    if (name.find('=') != std::string::npos || (name + value).find('\n') != std::string::npos)
      throw UsageError("identity: '", name, "' has a '=' in its name or a line break");
    text += str(name, "=", value, "\n");
  }
  return text;
}

MapFingerprint identity_from(std::string_view text) {
  MapFingerprint identity;
  std::istringstream lines{std::string(text)};
  for (std::string line; std::getline(lines, line);) {
    const size_t equals = line.find('=');
    identity[line.substr(0, equals)] = equals == std::string::npos ? "" : line.substr(equals + 1);
  }
  return identity;
}

void must_match(const std::string& name, const MapFingerprint& map, const MapFingerprint& program) {
  std::string differences;
  MapFingerprint names = map;
  names.insert(program.begin(), program.end());
  const auto entry = [](const MapFingerprint& identity, const std::string& key) {
    const auto found = identity.find(key);
    return found == identity.end() ? std::string("none") : "'" + found->second + "'";
  };
  for (const auto& [key, value] : names)
    if (entry(map, key) != entry(program, key))
      differences += str("\n  ", key, ": the map has ", entry(map, key), ", this program ",
                         entry(program, key));
  if (!differences.empty())
    throw InputError(name, ": its descriptors differ from those of this program:", differences,
                     "\nuse the map's configuration, or create another map");
}

}  // namespace revisit
