#include "report/html.h"

#include <google/protobuf/util/json_util.h>

#include "report_assets.h"
#include "revisit/proto/error.h"

namespace revisit::cli {
namespace {

/// As the content of a script element: protobuf writes '<' as \u003c, so that no "</script" and no
/// "<!--" can come out of it.
std::string script_json(const reports::Page& page) {
  google::protobuf::util::JsonPrintOptions options;
  options.preserve_proto_field_names = true;
  std::string text;
  const auto status = google::protobuf::util::MessageToJsonString(page, &text, options);
  if (!status.ok()) throw Error("cannot write JSON: " + status.ToString());
  return text;
}

}  // namespace

bool has_plot_library() {
  return !std::string_view(assets::kPlotLibrary).empty();
}

std::string html_escaped(const std::string& text) {
  std::string safe;
  for (const char c : text) {
    switch (c) {
      case '&':
        safe += "&amp;";
        break;
      case '<':
        safe += "&lt;";
        break;
      case '>':
        safe += "&gt;";
        break;
      case '"':
        safe += "&quot;";
        break;
      default:
        safe += c;
    }
  }
  return safe;
}

std::string html_page(const reports::Page& page) {
  return str(
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
      "<meta name=\"color-scheme\" content=\"light dark\">\n"
      "<link rel=\"icon\" href=\"data:,\">\n<title>",
      html_escaped(page.title()), "</title>\n<style>\n", assets::kStyle,
      "</style>\n</head>\n<body>\n<noscript>This report draws its figures with JavaScript, from "
      "data within this file. The same figures are beside it as SVG and "
      "PNG.</noscript>\n",
      kHtmlMark, "\n<script type=\"application/json\" id=\"data\">", script_json(page),
      "</script>\n<script>", assets::kPlotLibrary, "</script>\n<script>", assets::kScript,
      "</script>\n</body>\n</html>\n");
}

}  // namespace revisit::cli
