#include "io/point_table.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>
#include <cstring>

#include "revisit/proto/error.h"

namespace revisit::pipeline {
namespace {

constexpr std::string_view kBlanks = " \t";

/// The columns of a file that make a Point.
struct Member {
  const char* column;
  float Point::*value;
};
constexpr std::array<Member, 4> kMembers = {
    {{"x", &Point::x}, {"y", &Point::y}, {"z", &Point::z}, {"intensity", &Point::intensity}}};

template <class T>
void copy_column(const char* first, size_t stride, bool swap, float Point::*member,
                 std::vector<Point>* points) {
  for (Point& point : *points) {
    std::array<char, sizeof(T)> bytes;
    std::memcpy(bytes.data(), first, sizeof(T));
    if (swap) std::reverse(bytes.begin(), bytes.end());
    T value;
    std::memcpy(&value, bytes.data(), sizeof(T));
    point.*member = static_cast<float>(value);
    first += stride;
  }
}

void copy_column(ScalarType type, const char* first, size_t stride, bool swap, float Point::*member,
                 std::vector<Point>* points) {
  switch (type) {
    case ScalarType::kInt8:
      return copy_column<int8_t>(first, stride, swap, member, points);
    case ScalarType::kUint8:
      return copy_column<uint8_t>(first, stride, swap, member, points);
    case ScalarType::kInt16:
      return copy_column<int16_t>(first, stride, swap, member, points);
    case ScalarType::kUint16:
      return copy_column<uint16_t>(first, stride, swap, member, points);
    case ScalarType::kInt32:
      return copy_column<int32_t>(first, stride, swap, member, points);
    case ScalarType::kUint32:
      return copy_column<uint32_t>(first, stride, swap, member, points);
    case ScalarType::kInt64:
      return copy_column<int64_t>(first, stride, swap, member, points);
    case ScalarType::kUint64:
      return copy_column<uint64_t>(first, stride, swap, member, points);
    case ScalarType::kFloat32:
      return copy_column<float>(first, stride, swap, member, points);
    case ScalarType::kFloat64:
      return copy_column<double>(first, stride, swap, member, points);
  }
}

double parse_value(std::string_view word, const std::string& where) {
  const char* const first = word.data() + (word.starts_with('+') ? 1 : 0);
  const char* const last = word.data() + word.size();
  double value = 0;
  const auto [stop, error] = std::from_chars(first, last, value);  // takes nan and inf too
  if (error != std::errc() || stop != last)
    throw InputError(str(where, ": expected a number, found '", word.substr(0, 40), "'"));
  return value;
}

}  // namespace

bool TextCursor::next(std::string_view* line) {
  if (rest_.empty()) return false;
  const size_t end = rest_.find('\n');
  *line = rest_.substr(0, end);
  rest_.remove_prefix(end == std::string_view::npos ? rest_.size() : end + 1);
  if (line->ends_with('\r')) line->remove_suffix(1);
  ++line_;
  return true;
}

std::string TextCursor::where() const {
  return str(name_, ":", line_);
}

std::string_view take_word(std::string_view* text) {
  const size_t begin = std::min(text->find_first_not_of(kBlanks), text->size());
  const std::string_view word =
      text->substr(begin, std::min(text->find_first_of(kBlanks, begin), text->size()) - begin);
  text->remove_prefix(begin + word.size());
  return word;
}

size_t parse_count(std::string_view word, const std::string& where) {
  uint32_t value = 0;
  const auto [stop, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc() || stop != word.data() + word.size())
    throw InputError(
        str(where, ": expected a count from 0 to 4294967295, found '", word.substr(0, 40), "'"));
  return value;
}

size_t size_of(ScalarType type) {
  switch (type) {
    case ScalarType::kInt8:
    case ScalarType::kUint8:
      return 1;
    case ScalarType::kInt16:
    case ScalarType::kUint16:
      return 2;
    case ScalarType::kInt32:
    case ScalarType::kUint32:
    case ScalarType::kFloat32:
      return 4;
    case ScalarType::kInt64:
    case ScalarType::kUint64:
    case ScalarType::kFloat64:
      break;
  }
  return 8;
}

void PointTable::add(std::string_view name, ScalarType type, size_t count) {
  columns_.push_back({std::string(name), type, count, row_bytes_, row_values_});
  row_bytes_ += count * size_of(type);
  row_values_ += count;
}

const PointTable::Column* PointTable::find(std::string_view name) const {
  const auto found = std::find_if(columns_.begin(), columns_.end(), [&](const Column& column) {
    return column.name == name && column.count == 1;
  });
  return found == columns_.end() ? nullptr : &*found;
}

void PointTable::check(const std::string& where) const {
  std::string names;
  for (const Column& column : columns_) names += " " + column.name.substr(0, 40);
  for (const char* const name : {"x", "y", "z"})
    if (!find(name))
      throw InputError(str(where, ": expected x, y and z, one value each; no such '", name,
                           "', found", names.empty() ? " nothing" : names));
}

PointCloud PointTable::decode_rows(const char* rows, bool big_endian) const {
  PointCloud cloud;
  cloud.points.resize(points);
  for (const Member& member : kMembers)
    if (const Column* const column = find(member.column))
      copy_column(column->type, rows + column->offset, row_bytes_, big_endian, member.value,
                  &cloud.points);
  return cloud;
}

PointCloud PointTable::decode_columns(const char* columns) const {
  PointCloud cloud;
  cloud.points.resize(points);
  for (const Member& member : kMembers)
    if (const Column* const column = find(member.column))
      copy_column(column->type, columns + column->offset * points, size_of(column->type), false,
                  member.value, &cloud.points);
  return cloud;
}

PointCloud PointTable::parse_rows(TextCursor* text) const {
  std::array<const Column*, kMembers.size()> wanted;
  for (size_t m = 0; m < kMembers.size(); ++m) wanted[m] = find(kMembers[m].column);

  PointCloud cloud;
  cloud.points.reserve(std::min(points, text->rest().size() / row_values_));
  std::string_view line;
  while (cloud.points.size() < points) {
    if (!text->next(&line))
      throw InputError(str(text->name(), ": truncated: expected ", points, " points, found ",
                           cloud.points.size()));
    Point point;
    size_t values = 0;
    for (std::string_view word; !(word = take_word(&line)).empty(); ++values) {
      const double value = parse_value(word, text->where());
      for (size_t m = 0; m < kMembers.size(); ++m)
        if (wanted[m] && wanted[m]->index == values)
          point.*kMembers[m].value = static_cast<float>(value);
    }
    if (values == 0) continue;
    if (values != row_values_)
      throw InputError(str(text->where(), ": expected ", row_values_, " values, found ", values));
    cloud.points.push_back(point);
  }
  return cloud;
}

}  // namespace revisit::pipeline
