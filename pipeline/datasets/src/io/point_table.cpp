#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>

#include "io/point_files.h"
#include "revisit/base/error.h"
#include "revisit/datasets/scan_file.h"

namespace revisit {
namespace {

constexpr const char *kSeconds = "timestampSec", *kNanoseconds = "timestampNsec";
constexpr double kSecond = 1e9;  // [ns]

struct Member {
  const char* column;
  float Point::*value;
};
constexpr std::array<Member, 4> kMembers = {
    {{"x", &Point::x}, {"y", &Point::y}, {"z", &Point::z}, {"intensity", &Point::intensity}}};

}  // namespace

size_t parse_count(std::string_view word, const std::string& where) {
  uint32_t value = 0;
  const auto [stop, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc() || stop != word.data() + word.size())
    throw InputError(where, ": expected a count from 0 to 4294967295, found '", word.substr(0, 40),
                     "'");
  return value;
}

void PointTable::add(std::string_view name, NumberType type, size_t count) {
  columns_.push_back({std::string(name), type, count, row_bytes_, row_values_});
  row_bytes_ += count * type.bytes;
  row_values_ += count;
}

const PointTable::Column* PointTable::find(std::string_view name) const {
  const auto found = std::find_if(columns_.begin(), columns_.end(), [&](const Column& column) {
    return column.name == name && column.count == 1;
  });
  return found == columns_.end() ? nullptr : &*found;
}

const PointTable::Column* PointTable::find_time() const {
  for (const std::string_view name : kPointTimeNames) {
    if (name == "t" && find("s")) continue;  // texture coordinates
    if (name == kSeconds && !find(kNanoseconds)) continue;
    if (const Column* const column = find(name)) return column;
  }
  return nullptr;
}

void PointTable::check(const std::string& where) const {
  std::string names;
  for (const Column& column : columns_) names.append(" ").append(column.name, 0, 40);
  for (const char* const name : {"x", "y", "z"})
    if (!find(name))
      throw InputError(where, ": expected x, y and z, one value each; no such '", name, "', found",
                       names.empty() ? " nothing" : names);
}

PointCloud PointTable::decode(const char* data, Layout layout, RecordedTimes& times) const {
  const bool in_columns = layout == Layout::kColumns;
  const auto each_value = [&](const Column& column, const auto& take) {
    NumberType type = column.type;
    type.big_endian = layout == Layout::kBigEndianRows;
    const NumberReader read = number_reader(type);
    const char* at = data + column.offset * (in_columns ? points : 1);
    for (size_t i = 0; i < points; ++i, at += in_columns ? type.bytes : row_bytes_)
      take(i, read(at));
  };
  PointCloud cloud;
  cloud.points.resize(points);
  for (const Member& member : kMembers)
    if (const Column* const column = find(member.column))
      each_value(*column, [&](size_t i, double value) {
        cloud.points[i].*member.value = static_cast<float>(value);
      });
  if (const Column* const column = find_time()) {
    times.field = column->name;
    times.values.resize(points);
    each_value(*column, [&](size_t i, double value) { times.values[i] = value; });
    if (column->name == kSeconds)
      each_value(*find(kNanoseconds), [&](size_t i, double value) {
        times.values[i] = kSecond * times.values[i] + value;
      });
  }
  return cloud;
}

PointCloud PointTable::parse_rows(TextCursor* text, RecordedTimes& times) const {
  std::array<const Column*, kMembers.size()> wanted;
  for (size_t m = 0; m < kMembers.size(); ++m) wanted[m] = find(kMembers[m].column);
  const Column* const time = find_time();
  const Column* const nano = time && time->name == kSeconds ? find(kNanoseconds) : nullptr;
  if (time) times.field = time->name;

  PointCloud cloud;
  cloud.points.reserve(std::min(points, text->rest().size() / row_values_));
  std::string_view line;
  while (cloud.points.size() < points) {
    if (!text->next(&line))
      throw InputError(text->name(), ": truncated: expected ", points, " points, found ",
                       cloud.points.size());
    Point point;
    double seconds = 0, nanoseconds = 0;
    size_t values = 0;
    for (std::string_view word; !(word = take_word(&line)).empty(); ++values) {
      const double value = parse_number(word, text->where(), true);
      for (size_t m = 0; m < kMembers.size(); ++m)
        if (wanted[m] && wanted[m]->index == values)
          point.*kMembers[m].value = static_cast<float>(value);
      if (time && time->index == values) seconds = value;
      if (nano && nano->index == values) nanoseconds = value;
    }
    if (values == 0) continue;
    if (values != row_values_)
      throw InputError(text->where(), ": expected ", row_values_, " values, found ", values);
    cloud.points.push_back(point);
    if (time) times.values.push_back(nano ? kSecond * seconds + nanoseconds : seconds);
  }
  return cloud;
}

}  // namespace revisit
