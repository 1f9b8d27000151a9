#include <algorithm>
#include <sstream>
#include <utility>

#include "postgres_map.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit::postgres {
namespace {

void check_map_name(const std::string& map) {
  const auto fits = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_';
  };
  // The server truncates longer names; names with pg_ are reserved.
  if (map.empty() || map.size() > 40 || !std::ranges::all_of(map, fits) ||
      !(map[0] >= 'a' && map[0] <= 'z') || map.starts_with("pg_"))
    throw UsageError("map=", map,
                     ": expected a lower-case letter, then lower-case letters, digits and _, "
                     "at most 40, not beginning with pg_");
}

std::chrono::milliseconds seconds(const std::string& text) {
  const double value = finite_number(text).value_or(-1);
  if (!(value >= 0 && value <= 1e6))
    throw UsageError("patience=", text, ": expected seconds, 0 to 1000000");
  return std::chrono::milliseconds(static_cast<int64_t>(value * 1000));
}

}  // namespace

Address parse_address(const std::string& where) {
  // scheme://USER:PASSWORD@HOST...; as in libpq, the password may contain any character except /
  // and @.
  const size_t user = where.find("://") + 3, stop = where.find_first_of("@/", user);
  const bool has_user = stop != std::string::npos && where[stop] == '@';
  const size_t question = where.find('?', has_user ? stop : user);
  Address address;
  address.url = address.name = where.substr(0, question);
  if (const size_t colon = where.find(':', user); has_user && colon < stop) {
    address.password = where.substr(colon + 1, stop - colon - 1);
    address.name.erase(colon, stop - colon);
  }

  std::istringstream parameters(question == std::string::npos ? "" : where.substr(question + 1));
  std::string of_libpq;
  char before_name = '?';
  for (std::string entry; std::getline(parameters, entry, '&');) {
    const std::string key = entry.substr(0, entry.find('=')),
                      value = entry.substr(std::min(key.size() + 1, entry.size()));
    if (key == "map")
      check_map_name(address.map = value);
    else if (key == "patience")
      address.patience = seconds(value);
    else
      of_libpq += '&' + entry;
    if (key == "password")
      address.password = value;
    else if (key != "sslpassword")
      address.name += std::exchange(before_name, '&') + entry;
  }
  // libpq's defaults wait forever for a server that accepts but does not answer, and 15 minutes for
  // an unreachable machine. The last entry of a name counts, so that users can override these.
  const int64_t patience = std::chrono::ceil<std::chrono::seconds>(address.patience).count();
  address.url += str("?connect_timeout=", std::max<int64_t>(2, patience),
                     "&keepalives_idle=10&keepalives_interval=5&keepalives_count=4"
                     "&tcp_user_timeout=30000",
                     of_libpq);
  return address;
}

}  // namespace revisit::postgres
