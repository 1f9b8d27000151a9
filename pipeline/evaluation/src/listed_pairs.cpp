#include "revisit/evaluation/listed_pairs.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/base/text.h"

namespace revisit {
namespace {

constexpr std::array<std::string_view, 4> kQueryColumns = {"query", "query_index", "query_frame",
                                                           "frame"};
constexpr std::array<std::string_view, 5> kPlaceColumns = {"place", "match", "match_index",
                                                           "match_frame", "place_frame"};

std::string trimmed(std::string_view text) {
  constexpr std::string_view kBlanks = " \t\r\"";
  const size_t begin = text.find_first_not_of(kBlanks);
  if (begin == std::string_view::npos) return "";
  return std::string(text.substr(begin, text.find_last_not_of(kBlanks) + 1 - begin));
}

/// Cells of a line; blanks are separators only in lines without others.
std::vector<std::string> cells_of(std::string_view line) {
  std::string_view separators = ",;\t";
  const std::string text = trimmed(line);
  if (line.find_first_of(separators) == std::string_view::npos) {
    separators = " ";
    line = text;
  }
  std::vector<std::string> cells;
  while (true) {
    const size_t end = std::min(line.find_first_of(separators), line.size());
    std::string cell = trimmed(line.substr(0, end));
    if (!cell.empty() || separators != " ") cells.push_back(std::move(cell));
    if (end == line.size()) return cells;
    line.remove_prefix(end + 1);
  }
}

template <size_t n>
std::optional<size_t> column_of(const std::vector<std::string>& header,
                                const std::array<std::string_view, n>& names) {
  for (const std::string_view name : names)
    if (const auto at = std::ranges::find(header, name); at != header.end())
      return static_cast<size_t>(at - header.begin());
  return std::nullopt;
}

class ScanNames {
 public:
  explicit ScanNames(const Dataset& dataset) : dataset_(dataset) {
    for (size_t row = 0; row < dataset.scans.size(); ++row) {
      const ScanRef& scan = dataset.scans[row];
      const std::string folder = scan.place.empty() ? "" : scan.place + "/";
      rows_[folder + scan.file.stem().string()].insert(row);
      rows_[folder + scan.file.filename().string()].insert(row);
      of_frames_.emplace(scan.frame, row);
    }
  }

  size_t row_of(const std::string& name, const std::string& where) const {
    std::set<size_t> rows;
    if (const auto named = rows_.find(name); named != rows_.end()) rows = named->second;
    int frame = 0;
    const char* const end = name.data() + name.size();
    const auto [stop, error] = std::from_chars(name.data(), end, frame);
    const auto numbered = of_frames_.find(frame);
    if (error == std::errc() && stop == end && numbered != of_frames_.end())
      rows.insert(numbered->second);
    if (rows.size() == 1) return *rows.begin();
    if (!rows.empty()) {
      const auto file_of = [&](size_t row) { return dataset_.scans[row].file.string(); };
      throw InputError(where, ": '", name.substr(0, 80), "' may be ", file_of(*rows.begin()),
                       " or ", file_of(*rows.rbegin()), ": give the whole name of the file");
    }
    const ScanRef &first = dataset_.scans.front(), &last = dataset_.scans.back();
    const auto name_of = [](const ScanRef& scan) {
      return (scan.place.empty() ? "" : scan.place + "/") + scan.file.stem().string();
    };
    throw InputError(where, ": expected a scan of ", dataset_.name, ", frame ", first.frame, " (",
                     name_of(first), ") to ", last.frame, " (", name_of(last), "), found '",
                     name.substr(0, 80), "'");
  }

 private:
  const Dataset& dataset_;
  std::map<std::string, std::set<size_t>> rows_;
  std::map<int, size_t> of_frames_;
};

void add_near(const Dataset& dataset, size_t row, int near, std::set<int>& frames) {
  const ScanRef& place = dataset.scans[row];
  const auto counts = [&](const ScanRef& scan) {
    return scan.place == place.place && std::abs(scan.frame - place.frame) <= near;
  };
  size_t first = row, end = row + 1;
  while (first > 0 && counts(dataset.scans[first - 1])) --first;
  while (end < dataset.scans.size() && counts(dataset.scans[end])) ++end;
  for (size_t at = first; at < end; ++at) frames.insert(dataset.scans[at].frame);
}

}  // namespace

std::string ListedPairs::text() const {
  std::string text = complete ? "complete" : "";
  for (const auto& [kind, places] :
       {std::pair("right", &correct), std::pair("neither", &ignored)}) {
    text += str("\n", kind);
    for (const auto& [query, of_query] : *places)
      text += str(" ", query, ":", joined(of_query, ","));
  }
  return text;
}

ListedPairs::Places read_pairs(const std::filesystem::path& file, const Dataset& dataset,
                               int near) {
  if (near < 0) throw UsageError("pairs: expected at least 0 frames near a place, found ", near);
  if (dataset.scans.empty()) throw UsageError("pairs: the data set has no scans");
  const ScanNames names(dataset);
  const std::string content = read_content(file);
  ListedPairs::Places pairs;
  size_t query = 0, place = 1;
  bool first = true;
  std::string_view rest = content;
  if (rest.starts_with("\xEF\xBB\xBF")) rest.remove_prefix(3);
  for (int64_t number = 1; !rest.empty(); ++number) {
    const size_t end = std::min(rest.find('\n'), rest.size());
    std::string_view line = rest.substr(0, end);
    rest.remove_prefix(std::min(end + 1, rest.size()));
    line = line.substr(0, line.find('#'));
    const std::vector<std::string> cells = cells_of(line);
    if (std::ranges::all_of(cells, &std::string::empty)) continue;
    const std::string where = str(file.string(), ":", number);
    if (std::exchange(first, false))
      if (const auto queries = column_of(cells, kQueryColumns)) {
        const auto places = column_of(cells, kPlaceColumns);
        if (!places) throw InputError(where, ": expected a column 'place' beside the queries");
        query = *queries;
        place = *places;
        continue;
      }
    if (query >= cells.size() || cells[query].empty())
      throw InputError(where, ": expected a query and its place, found '", trimmed(line), "'");
    std::set<int>& frames = pairs[dataset.scans[names.row_of(cells[query], where)].frame];
    if (place < cells.size() && !cells[place].empty())
      add_near(dataset, names.row_of(cells[place], where), near, frames);
  }
  if (pairs.empty()) throw InputError(file.string(), ": lists no pairs");
  return pairs;
}

}  // namespace revisit
