#include <filesystem>

#include "commands/net_commands.h"
#include "report/page.h"

namespace revisit::cli {

std::string profile_page(const reports::NetReport& report, const std::string& command) {
  const std::string file = std::filesystem::path(report.prototxt()).filename().string();
  PageOptions options;
  options.title = "Profile of " + (report.net().empty() ? file : report.net());
  options.command = command;
  reports::Page page;
  *page.add_profiles() = report;
  complete_page(options, &page);
  return html_page(page);
}

}  // namespace revisit::cli
