#include "postgres_map.h"
#include "revisit/recognition/optional_library.h"

namespace revisit {

std::unique_ptr<SqlDriver> open_postgres_map(const std::string&, MapAccess, const MapFingerprint*,
                                             DescriptorType) {
  built_without("a map on a PostgreSQL server", "libpq");
}

}  // namespace revisit
