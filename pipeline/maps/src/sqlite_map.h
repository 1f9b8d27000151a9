#pragma once

#include <functional>
#include <map>
#include <string>

#include "revisit/maps/map_store.h"
#include "schema.h"
#include "sqlite.h"
#include "writer_lock.h"

namespace revisit {

class SqliteMap : public MapStore {
 public:
  /// `lock`: null for a reader.
  SqliteMap(std::unique_ptr<WriterLock> lock, std::unique_ptr<sqlite::Connection> connection);
  ~SqliteMap() override;

  const MapFingerprint& fingerprint() const override { return head_.identity; }
  DescriptorType descriptor_type() const override { return head_.format; }
  int64_t size() const override;
  std::optional<std::string> value(const std::string& name) const override;
  void set_value(const std::string& name, const std::string& bytes) override;
  std::vector<int64_t> add(std::span<const StoredPlace> places,
                           std::optional<int64_t> revision = std::nullopt) override;
  MapState read(int64_t after, const Take& take, const Warn& warn) const override;
  bool replace_descriptors(
      const std::function<std::vector<float>(const StoredPlace&)>& descriptor_of,
      const std::map<std::string, std::string>& values, int64_t revision) override;
  std::string cloud(int64_t id) const override;
  int64_t remove(std::span<const int64_t> ids) override;
  std::vector<int64_t> removed(int64_t after = 0) const override;
  void check(const Warn& wrong) const override;

 private:
  struct Value {
    int64_t id;
    std::string bytes;
    bool valid = true;
  };
  void must_be_writer() const;
  /// Must run in a transaction. Throws InputError if a value that a map needs is corrupt.
  std::map<std::string, Value> read_values() const;
  void fail_unless_valid(const Value& value) const;
  void put_value(const std::string& name, const std::string& bytes);

  std::unique_ptr<WriterLock> lock_;  // released after the connection
  std::unique_ptr<sqlite::Connection> connection_;
  MapHead head_;
};

}  // namespace revisit
