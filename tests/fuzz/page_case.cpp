#include "page_case.h"

#include <algorithm>
#include <sstream>

#include "cli/json.h"
#include "report/report.h"

namespace revisit::fuzz {
namespace {

bool is_small(const reports::Run& run) {
  const auto side = [](int pixels) { return pixels < 1000; };
  return side(run.info().image_width()) && side(run.info().image_height());
}

bool can_be_read(const reports::Page& page) {
  reports::Page again;
  try {
    cli::parse_report(cli::to_compact_json(page), "<page>", &again);
  } catch (const InputError&) {
    return false;
  }
  return true;
}

}  // namespace

void make_page(const std::filesystem::path& place) {
  static const InputFile scan(std::string(64, 'A'), ".bin");  // four points
  works_or_refuses([&] {
    reports::Page page = cli::read_runs({place});
    if (!std::ranges::all_of(page.runs(), is_small)) return;
    for (reports::Run& run : *page.mutable_runs())
      for (std::string& file : *run.mutable_file()) file = scan.path();
    cli::complete_page({}, &page);
    const auto marks = [](const std::string& html) { return std::ranges::count(html, '<'); };
    static const auto own = marks(cli::html_page({}));
    require(marks(cli::html_page(page)) == own, "nothing in the data begins markup");
    require(can_be_read(page), "the data of a page can be read");
  });
}

}  // namespace revisit::fuzz
