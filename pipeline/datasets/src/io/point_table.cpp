#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>

#include "io/point_files.h"
#include "revisit/base/error.h"
#include "revisit/datasets/scan_file.h"

namespace revisit {
namespace {

struct Member {
  const char* column;
  float Point::*value;
};
constexpr std::array<Member, 4> kMembers = {
    {{"x", &Point::x}, {"y", &Point::y}, {"z", &Point::z}, {"intensity", &Point::intensity}}};

bool are_nanoseconds(const NumberType& type) {
  return type.kind != 'f';
}

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

PointCloud PointTable::decode(const char* data, Layout layout) const {
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
    std::vector<double> times(points);
    each_value(*column, [&](size_t i, double value) { times[i] = value; });
    cloud.times = point_times(times, are_nanoseconds(column->type));
  }
  return cloud;
}

PointCloud PointTable::parse_rows(TextCursor* text) const {
  std::array<const Column*, kMembers.size()> wanted;
  for (size_t m = 0; m < kMembers.size(); ++m) wanted[m] = find(kMembers[m].column);
  const Column* const time = find_time();
  std::vector<double> times;

  PointCloud cloud;
  cloud.points.reserve(std::min(points, text->rest().size() / row_values_));
  std::string_view line;
  while (cloud.points.size() < points) {
    if (!text->next(&line))
      throw InputError(text->name(), ": truncated: expected ", points, " points, found ",
                       cloud.points.size());
    Point point;
    size_t values = 0;
    for (std::string_view word; !(word = take_word(&line)).empty(); ++values) {
      const double value = parse_number(word, text->where(), true);
      for (size_t m = 0; m < kMembers.size(); ++m)
        if (wanted[m] && wanted[m]->index == values)
          point.*kMembers[m].value = static_cast<float>(value);
      if (time && time->index == values) times.push_back(value);
    }
    if (values == 0) continue;
    if (values != row_values_)
      throw InputError(text->where(), ": expected ", row_values_, " values, found ", values);
    cloud.points.push_back(point);
  }
  if (time) cloud.times = point_times(times, are_nanoseconds(time->type));
  return cloud;
}

}  // namespace revisit
