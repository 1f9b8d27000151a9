#include <iostream>

#include "cli/command.h"
#include "cli/parser.h"
#include "cli/table.h"
#include "revisit/maps/map_store.h"
#include "revisit/proto/text.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;
using pipeline::MapAccess;
using pipeline::MapStore;
using pipeline::StoredPlace;

fs::path one_map(const char* command, const char* summary, const Arguments& arguments) {
  fs::path file;
  Parser parser(command, "FILE", summary, str("  ", command, " town.map\n"));
  parser.positional("FILE", &file);
  parser.parse(arguments);
  return file;
}

int info(const Arguments& arguments) {
  const fs::path file =
      one_map("revisit map info", "What a map was made with and what is in it.", arguments);
  const auto map = pipeline::open_map(file, MapAccess::kRead);
  Table table({"map", file.string()});
  table.row({"places", str(map->size())});
  table.row({"numbers",
             map->number_format() == pipeline::NumberFormat::kFloat16 ? "float16" : "float32"});
  for (const auto& [name, value] : map->identity()) table.row({name, value});
  const auto threshold = map->value("threshold");
  table.row({"threshold", threshold ? *threshold : "none: not calibrated"});
  table.row({"basis", map->value("basis") ? "learnt" : "not learnt yet"});
  table.print(std::cout);
  return kOk;
}

int check(const Arguments& arguments) {
  const fs::path file = one_map("revisit map check",
                                "Reads all of a map and says what is wrong with it. Exit code 5 "
                                "when something is.",
                                arguments);
  const std::vector<std::string> wrong = pipeline::check_map(file);
  for (const std::string& line : wrong) std::cout << line << "\n";
  if (wrong.empty()) std::cout << file.string() << ": sound\n";
  return wrong.empty() ? kOk : kCheckFailed;
}

int places(const Arguments& arguments) {
  const fs::path file =
      one_map("revisit map places", "The places of a map as CSV: where and when.", arguments);
  const auto map = pipeline::open_map(file, MapAccess::kRead);
  Table({"id", "drive", "frame", "time", "x", "y", "z"}).print_csv(std::cout);
  bool damaged = false;
  map->read(
      0,
      [](StoredPlace&& place) {
        const auto coordinate = [&](int axis) {
          return place.pose ? number(place.pose->translation()[axis], 3) : "";
        };
        Table({str(place.id), place.drive, str(place.frame),
               place.time ? number(*place.time, 6) : "", coordinate(0), coordinate(1),
               coordinate(2)})
            .print_csv(std::cout);
      },
      [&](const std::string& message) {
        damaged = true;
        std::cerr << "revisit: " << message << "\n";
      });
  return damaged ? kCheckFailed : kOk;
}

}  // namespace

int map_command(const Arguments& arguments) {
  return dispatch("revisit map", "The places that `revisit loops --map` keeps.\n",
                  {{"info", "what a map was made with", info},
                   {"places", "its places, as CSV", places},
                   {"check", "what is wrong with it", check}},
                  arguments);
}

}  // namespace revisit::cli
