#pragma once

#include <chrono>
#include <memory>
#include <string>

#include "revisit/maps/map_store.h"
#include "sql_driver.h"

namespace revisit {

/// Like open_map(), which compares the fingerprint.
std::unique_ptr<SqlDriver> open_postgres_map(const std::string& where, MapAccess access,
                                             const MapFingerprint* fingerprint,
                                             DescriptorType format);

namespace postgres {

struct Address {
  std::string url;   // for libpq, without map= and patience=, which it does not know
  std::string name;  // for messages: without the password
  std::string password;
  std::string map = "revisit";
  std::chrono::milliseconds patience{10'000};  // maximum time to reconnect after a lost connection
};

Address parse_address(const std::string& where);

}  // namespace postgres
}  // namespace revisit
