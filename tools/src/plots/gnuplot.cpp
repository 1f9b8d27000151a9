#include "plots/gnuplot.h"

#include <fstream>
#include <string_view>

#include "cli/run_program.h"
#include "revisit/proto/atomic_file.h"
#include "revisit/proto/error.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// Look of every plot: quiet axes, a light grid, and colours that also differ for the colour-blind
/// (Okabe and Ito).
constexpr const char* kStyle = R"(set encoding utf8
set border 3 linewidth 1.2 linecolor rgb '#555555'
set tics nomirror out scale 0.6 textcolor rgb '#333333'
set grid linecolor rgb '#e4e4e4' linewidth 1 linetype 1, linecolor rgb '#e4e4e4' linewidth 1 linetype 1
set linetype 1 linecolor rgb '#0072b2' linewidth 2.6
set linetype 2 linecolor rgb '#d55e00' linewidth 2.6
set linetype 3 linecolor rgb '#009e73' linewidth 2.6
set linetype 4 linecolor rgb '#cc79a7' linewidth 2.6
set linetype 5 linecolor rgb '#e69f00' linewidth 2.6
set linetype 6 linecolor rgb '#56b4e9' linewidth 2.6
set linetype 7 linecolor rgb '#000000' linewidth 2.6
set linetype cycle 7
set key noenhanced spacing 1.25 textcolor rgb '#222222'
set title offset 0,0.4 font ',17' noenhanced
)";

/// Whether a picture has its end: gnuplot says nothing of a full disk.
bool has_end(const fs::path& file, std::string_view end) {
  constexpr std::streamoff kTail = 16;  // [bytes]; blank lines may follow
  std::ifstream in(file, std::ios::binary | std::ios::ate);
  const auto size = static_cast<std::streamoff>(in.tellg());
  std::string tail(kTail, '\0');
  return size >= kTail && in.seekg(size - kTail) && in.read(tail.data(), kTail) &&
         tail.find(end) != std::string::npos;
}

}  // namespace

std::string quoted(const std::string& text) {
  std::string literal = "'";  // in single quotes gnuplot interprets nothing but the quote
  for (const char c : text) literal += c == '\'' ? "''" : c == '\n' ? " " : std::string(1, c);
  return literal + "'";
}

PlotFiles draw(const fs::path& folder, const std::string& name, const std::string& data,
               const std::string& commands, int height) {
  const fs::path absolute = fs::absolute(folder);
  const PlotFiles files{absolute / (name + ".dat"), absolute / (name + ".gp"),
                        absolute / (name + ".png"), absolute / (name + ".svg"), ""};
  std::error_code ignored;
  fs::create_directories(absolute, ignored);
  // A picture of an earlier run must not stand beside the new data.
  fs::remove(files.png, ignored);
  fs::remove(files.svg, ignored);
  write_atomically(files.data, [&](std::ostream& out) { out << data; });
  write_atomically(files.script, [&](std::ostream& out) {
    out << "# Drawn by revisit; edit and run: gnuplot " << name << ".gp\n";
    // Each picture is drawn from the beginning: `replot` would repeat the last panel only.
    for (const auto& [terminal, ending] : {std::pair{"pngcairo", ".png"}, {"svg", ".svg"}})
      out << "reset\nset terminal " << terminal << " size 1200," << height
          << " font 'Sans,14' background rgb 'white'\n"
          << "set output " << quoted(name + ending) << "\n"
          << kStyle << commands << "\n";
    out << "unset output\n";
  });
  PlotFiles result = files;
  std::string problem = run_program(absolute, {"gnuplot", name + ".gp"}, "gnuplot-nox");
  if (problem.empty() && !(has_end(files.png, "IEND") && has_end(files.svg, "</svg>")))
    problem = "gnuplot left it unfinished; is the disk full?";
  if (problem.empty()) return result;
  fs::remove(files.png, ignored);
  fs::remove(files.svg, ignored);
  result.warning = str("no picture for ", files.script.string(), ": ", problem);
  return result;
}

}  // namespace revisit::cli
