#include "map_store.h"

#include <nanobind/eigen/dense.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include <filesystem>

#include "arrays.h"
#include "module.h"
#include "points.h"
#include "unlocked.h"

namespace revisit::python {
namespace {

namespace fs = std::filesystem;
using namespace nb::literals;

std::vector<MapEntry> entries_of(OpenMap& map, int64_t after) {
  return map.with([&](const MapStore& store) {
    std::vector<MapEntry> entries;
    store.read(
        after, [&](MapEntry&& entry) { entries.push_back(std::move(entry)); },
        [&](const std::string& message) { map.messages.add(message); });
    return entries;
  });
}

void bind_entry(nb::module_& module) {
  nb::class_<MapEntry>(module, "MapEntry", "A map entry.")
      .def_ro("id", &MapEntry::id, "1, 2, ... in the order of adding.")
      .def_ro("drive", &MapEntry::drive, "Drive that the entry is from.")
      .def_ro("frame", &MapEntry::frame, "Frame in its drive.")
      .def_ro("time", &MapEntry::time, "[s], or None.")
      .def_prop_ro(
          "pose", [](const MapEntry& entry) { return matrix_of(entry.pose); },
          "T_world_sensor, float64 [4][4] [m], or None.")
      .def_prop_ro(
          "descriptor",
          [](nb::handle self) { return view_of(nb::cast<const MapEntry&>(self).descriptor, self); },
          "Stored descriptor, float32 [dimensions]; empty during the warm-up.")
      .def_prop_ro(
          "feature",
          [](nb::handle self) { return view_of(nb::cast<const MapEntry&>(self).feature, self); },
          "The feature before projection; empty once the descriptor projection is fixed.");
}

void bind_open_map(nb::module_& module) {
  nb::class_<OpenMap>(module, "MapStore", "The entries of one map, in a file or on a server.")
      .def_static(
          "open",
          [](const fs::path& file, bool write) {
            return std::make_unique<OpenMap>(without_lock(
                [&] { return open_map(file, write ? MapAccess::kWrite : MapAccess::kRead); }));
          },
          "file"_a, nb::kw_only(), "write"_a = false,
          "Opens an existing map for reading, or with `write` for remove(). open_map() creates "
          "one.\n"
          "Raises InputError if the file is not a map or is corrupt.")
      .def_prop_ro(
          "fingerprint",
          [](OpenMap& map) {
            return map.with([](const MapStore& store) { return store.fingerprint(); });
          },
          nb::call_guard<Unlocked>(), "Settings that define the descriptors, name -> value.")
      .def_prop_ro(
          "dtype",
          [](OpenMap& map) {
            return name_of(map.with([](const MapStore& store) { return store.descriptor_type(); }));
          },
          nb::call_guard<Unlocked>(), "Type of the stored descriptors: 'float32' or 'float16'.")
      .def(
          "__len__",
          [](OpenMap& map) { return map.with([](const MapStore& store) { return store.size(); }); },
          nb::call_guard<Unlocked>())
      .def("entries", &entries_of, nb::call_guard<Unlocked>(), "after"_a = 0,
           "Entries with ids above `after`, ascending, as one snapshot. Corrupted entries are "
           "skipped; `warnings` has a message for each. Raises UsageError after close().")
      .def(
          "remove",
          [](OpenMap& map, const std::vector<int64_t>& ids) {
            return map.with([&](MapStore& store) { return store.remove(ids); });
          },
          nb::call_guard<Unlocked>(), "ids"_a,
          "Removes entries permanently in one transaction, including corrupt ones. Ids are not "
          "reused. Returns the number of entries removed.\n"
          "Raises UsageError for an id that was never used, or if the map is open for reading.")
      .def(
          "removed",
          [](OpenMap& map, int64_t after) {
            return map.with([&](const MapStore& store) { return store.removed(after); });
          },
          nb::call_guard<Unlocked>(), "after"_a = 0,
          "Ids of removed entries, in order of removal, without the first `after`. Raises "
          "UsageError after close().")
      .def_prop_ro(
          "warnings", [](const OpenMap& map) { return map.messages.all(); },
          "Warnings about entries that could not be read.")
      .def("close", &OpenMap::close, nb::call_guard<Unlocked>(),
           "Closes the file or connection; later calls raise UsageError.")
      .def("__enter__", [](nb::handle self) { return nb::borrow(self); })
      .def(
          "__exit__", [](OpenMap& map, const nb::args&) { without_lock([&] { map.close(); }); },
          nb::sig("def __exit__(self, *args: object) -> None"));
}

}  // namespace

void bind_map_store(nb::module_& module) {
  bind_entry(module);
  bind_open_map(module);
  module.def(
      "feature_key_of", nb::overload_cast<const std::filesystem::path&>(&feature_key_of),
      nb::call_guard<Unlocked>(), "map"_a,
      "FeatureExtractor.key of the feature that made a map; '' if there is no readable map.");
  module.def("check_map", &check_map, nb::call_guard<Unlocked>(), "file"_a,
             "Reads a whole map. Returns one message per defect, none if the map is valid. Raises "
             "InputError if the file is missing, Error if it cannot be opened.");
  module.def(
      "merge_maps",
      [](const std::vector<fs::path>& maps, const fs::path& file) {
        std::vector<std::string> warnings;
        const int64_t entries = merge_maps(
            maps, file, [&](const std::string& message) { warnings.push_back(message); });
        return std::pair(entries, warnings);
      },
      nb::call_guard<Unlocked>(), "maps"_a, "file"_a,
      "Writes the entries of all maps to a new map. Returns the number of entries, and one message "
      "per unreadable entry, which is skipped. Raises InputError if the maps have other features "
      "or `file` exists, UsageError without maps.");
}

}  // namespace revisit::python
