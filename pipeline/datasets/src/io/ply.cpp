#include <algorithm>

#include "io/file_content.h"
#include "io/point_files.h"
#include "revisit/base/error.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;

struct Element {
  std::string_view name;
  PointTable table;
  bool has_lists = false;
};

struct PlyHeader {
  std::string_view format;  // ascii | binary_little_endian | binary_big_endian
  std::vector<Element> elements;
};

NumberType number_type(std::string_view name, const std::string& where) {
  if (name == "char" || name == "int8") return {'i', 1};
  if (name == "uchar" || name == "uint8") return {'u', 1};
  if (name == "short" || name == "int16") return {'i', 2};
  if (name == "ushort" || name == "uint16") return {'u', 2};
  if (name == "int" || name == "int32") return {'i', 4};
  if (name == "uint" || name == "uint32") return {'u', 4};
  if (name == "float" || name == "float32") return {'f', 4};
  if (name == "double" || name == "float64") return {'f', 8};
  throw InputError(where, ": unknown property type: '", name.substr(0, 40), "'");
}

/// Leaves `text` at the first byte of the elements.
PlyHeader read_ply_header(TextCursor* text) {
  std::string_view line;
  if (!text->next(&line) || line != "ply")
    throw InputError(text->name() + ":1: expected 'ply' as the first line");
  PlyHeader header;
  for (;;) {
    if (!text->next(&line))
      throw InputError(text->name() + ": the PLY header has no line end_header");
    const std::string_view key = take_word(&line);
    const std::string where = text->where();
    if (key == "end_header") break;
    if (key == "comment" || key == "obj_info") continue;
    if (key == "format") {
      header.format = take_word(&line);
    } else if (key == "element") {
      Element& element = header.elements.emplace_back();
      element.name = take_word(&line);
      element.table.points = parse_count(take_word(&line), where);
    } else if (key == "property") {
      if (header.elements.empty()) throw InputError(where + ": property before any element");
      Element& element = header.elements.back();
      const std::string_view type = take_word(&line);
      if (type == "list")
        element.has_lists = true;
      else
        element.table.add(take_word(&line), number_type(type, where), 1);
    } else {
      throw InputError(where, ": not a line of a PLY header: '", key.substr(0, 40), "'");
    }
  }
  if (header.format != "ascii" && header.format != "binary_little_endian" &&
      header.format != "binary_big_endian")
    throw InputError(text->where(), ": expected format ascii, binary_little_endian or ",
                     "binary_big_endian, found '", header.format.substr(0, 40), "'");
  return header;
}

PointCloud read_ascii(const PlyHeader& header, const Element& vertex, TextCursor* text,
                      RecordedTimes& times) {
  std::string_view line;
  for (const Element* element = header.elements.data(); element != &vertex; ++element)
    for (size_t i = 0; i < element->table.points; ++i)
      if (!text->next(&line)) throw InputError(text->name() + ": truncated before its vertices");
  return vertex.table.parse_rows(text, times);
}

PointCloud read_binary(const PlyHeader& header, const Element& vertex, const TextCursor& text,
                       RecordedTimes& times) {
  std::string_view body = text.rest();
  // Divides, because a product could overflow.
  const auto check_size = [&](const Element& element) {
    const size_t row = element.table.row_bytes();
    if (row > 0 && element.table.points > body.size() / row)
      throw InputError(text.where(), ": truncated: ", element.table.points, " of '",
                       element.name.substr(0, 40), "', ", row, " bytes each, do not fit the ",
                       body.size(), " bytes that follow");
  };
  for (const Element* element = header.elements.data(); element != &vertex; ++element) {
    if (element->has_lists)
      throw InputError(text.where(), ": element '", element->name.substr(0, 40),
                       "' holds lists and precedes the vertices, which is not supported; ",
                       "write the vertices first");
    check_size(*element);
    body.remove_prefix(element->table.points * element->table.row_bytes());
  }
  check_size(vertex);
  return vertex.table.decode(body.data(),
                             header.format == "binary_big_endian"
                                 ? PointTable::Layout::kBigEndianRows
                                 : PointTable::Layout::kRows,
                             times);
}

}  // namespace

PointCloud read_ply(const fs::path& file, RecordedTimes& times) {
  const std::string content = read_content(file);
  TextCursor text(content, file.string());
  const PlyHeader header = read_ply_header(&text);
  const auto vertex = std::find_if(header.elements.begin(), header.elements.end(),
                                   [](const Element& element) { return element.name == "vertex"; });
  if (vertex == header.elements.end())
    throw InputError(text.where() + ": the header has no element 'vertex'");
  if (vertex->has_lists)
    throw InputError(text.where() + ": vertices with list properties are not supported");
  vertex->table.check(text.where());
  return header.format == "ascii" ? read_ascii(header, *vertex, &text, times)
                                  : read_binary(header, *vertex, text, times);
}

}  // namespace revisit
