#pragma once

#include <filesystem>
#include <ostream>
#include <string>

namespace revisit::cli {

/// What a plot leaves beside the results: `NAME.dat`, `NAME.gp`, `NAME.png`, `NAME.svg`.
struct PlotFiles {
  std::filesystem::path data, script, png, svg;
  /// Empty, or why there is no picture (e.g. gnuplot is not installed); data and script are there.
  std::string warning;
};

/// A gnuplot string literal. Anything gnuplot would interpret in it is made plain.
std::string quoted(const std::string& text);

/// Writes `data` to FOLDER/NAME.dat and a script around `commands` to FOLDER/NAME.gp, and runs it
/// in that folder. `commands` is gnuplot code that refers to `"NAME.dat"` and ends with the plot;
/// the terminal (PNG 1200 pixels wide and `height` high, then SVG of the same shape), fonts, border
/// and line styles are set here. Anyone can edit the script and run `gnuplot NAME.gp` again. Throws
/// Error when the data or script cannot be written; a failing gnuplot is only a warning.
PlotFiles draw(const std::filesystem::path& folder, const std::string& name,
               const std::string& data, const std::string& commands, int height = 900);

}  // namespace revisit::cli
