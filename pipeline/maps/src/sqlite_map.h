#pragma once

#include <set>

#include "claims_of_one.h"
#include "revisit/maps/map_store.h"
#include "schema.h"
#include "sqlite.h"
#include "writer_lock.h"

namespace revisit::pipeline {

/// A map in a SQLite file.
class SqliteMap : public MapStore {
 public:
  /// `lock`: null for a reader. `losses`: what was found lost when the file was opened.
  SqliteMap(std::unique_ptr<WriterLock> lock, std::unique_ptr<sqlite::Connection> connection,
            std::vector<std::string> losses);
  ~SqliteMap() override;

  const MapIdentity& identity() const override { return head_.identity; }
  NumberFormat number_format() const override { return head_.format; }
  int64_t size() const override;
  std::optional<std::string> value(const std::string& name) const override;
  void set_value(const std::string& name, const std::string& bytes) override;
  std::vector<int64_t> add(std::span<const StoredPlace> places,
                           std::optional<int64_t> revision = std::nullopt,
                           Claim* claim = nullptr) override;
  void expect(const std::string& drive, std::span<const int64_t> frames) override;
  std::unique_ptr<Claim> claim(const std::string& drive, int64_t most) override;
  int64_t expected(const std::string& drive) const override { return claims_.expected(drive); }
  MapPosition read(int64_t after, const Take& take, const Damaged& damaged) const override;
  bool replace_descriptors(
      const std::function<std::vector<float>(const StoredPlace&)>& descriptor_of,
      const std::map<std::string, std::string>& values, int64_t revision) override;
  int64_t remove(std::span<const int64_t> ids) override;
  std::vector<int64_t> removed(int64_t after = 0) const override;

  /// What is wrong, a message each.
  std::vector<std::string> check() const;

 private:
  void must_be_writer() const;
  /// Within a transaction.
  void put_value(const std::string& name, const std::string& bytes);

  std::unique_ptr<WriterLock> lock_;  // let go after the connection
  std::unique_ptr<sqlite::Connection> connection_;
  MapHead head_;  // as it was when the file was opened
  std::vector<std::string> losses_;
  ClaimsOfOne claims_;
  mutable std::set<std::string> told_;
};

}  // namespace revisit::pipeline
