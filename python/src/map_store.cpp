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
#include "listener.h"
#include "module.h"
#include "poses.h"
#include "strings.h"

namespace revisit::python {
namespace {

namespace fs = std::filesystem;
using namespace nb::literals;
using namespace pipeline;

NumberFormat parse_numbers(const std::string& text) {
  if (text == "float32") return NumberFormat::kFloat32;
  if (text == "float16") return NumberFormat::kFloat16;
  throw UsageError("numbers: expected 'float32' or 'float16', found '", text, "'");
}

std::vector<StoredPlace> places_of(OpenMap& map, int64_t after) {
  return map.with([&](const MapStore& store) {
    std::vector<StoredPlace> places;
    store.read(
        after, [&](StoredPlace&& place) { places.push_back(std::move(place)); },
        [&](const std::string& message) { map.messages.add(message); });
    return places;
  });
}

void bind_place(nb::module_& module) {
  const auto view = [](const std::vector<float>& numbers, nb::handle self) {
    return view_of(numbers.data(), {static_cast<int64_t>(numbers.size())}, self);
  };
  nb::class_<StoredPlace>(module, "StoredPlace", "A place as a map keeps it.")
      .def_ro("id", &StoredPlace::id, "1, 2, ... in the order of adding.")
      .def_ro("drive", &StoredPlace::drive)
      .def_ro("frame", &StoredPlace::frame)
      .def_ro("time", &StoredPlace::time, "[s], or None.")
      .def_prop_ro(
          "pose", [](const StoredPlace& place) { return matrix_of(place.pose); },
          "T_world_sensor, or None.")
      .def_prop_ro("descriptor",
                   [view](nb::handle self) {
                     return view(nb::cast<const StoredPlace&>(self).descriptor, self);
                   })
      .def_prop_ro(
          "feature",
          [view](nb::handle self) {
            return view(nb::cast<const StoredPlace&>(self).feature, self);
          },
          "What the descriptor is made from; empty once the basis is fixed.");
}

void bind_open_map(nb::module_& module) {
  nb::class_<OpenMap>(module, "MapStore",
                      "The places of one map, in a file or on a server. It belongs to a "
                      "PlaceRecognizer once it was given to one.")
      .def_static(
          "open",
          [](const fs::path& file, const std::optional<MapIdentity>& identity,
             const std::string& numbers, bool write) {
            const NumberFormat format = parse_numbers(numbers);
            return std::make_unique<OpenMap>(without_lock([&] {
              return open_map(file, write || identity ? MapAccess::kWrite : MapAccess::kRead,
                              identity ? &*identity : nullptr, format);
            }));
          },
          "file"_a, "identity"_a = nb::none(), nb::kw_only(), "numbers"_a = "float32",
          "write"_a = false,
          "Without an identity: a map that is there, for reading, or with `write` for remove(). "
          "With "
          "one (PlaceRecognizer.identity_of()): for writing, made when there is none.\n\n"
          "numbers: of a new map, 'float32' or 'float16'.\n"
          "Raises InputError for a file that is not a map, a damaged map, and another identity.")
      .def_prop_ro(
          "identity",
          [](OpenMap& map) {
            return map.with([](const MapStore& store) { return store.identity(); });
          },
          nb::call_guard<Unlocked>())
      .def_prop_ro(
          "numbers",
          [](OpenMap& map) {
            const auto format =
                map.with([](const MapStore& store) { return store.number_format(); });
            return format == NumberFormat::kFloat16 ? "float16" : "float32";
          },
          nb::call_guard<Unlocked>())
      .def(
          "__len__",
          [](OpenMap& map) { return map.with([](const MapStore& store) { return store.size(); }); },
          nb::call_guard<Unlocked>())
      .def(
          "value",
          [](OpenMap& map, const std::string& name) -> std::optional<nb::bytes> {
            const auto value = without_lock(
                [&] { return map.with([&](const MapStore& store) { return store.value(name); }); });
            if (!value) return std::nullopt;
            return nb::bytes(value->data(), value->size());
          },
          "name"_a, "Bytes kept beside the places ('basis', 'threshold'), or None.")
      .def("places", &places_of, nb::call_guard<Unlocked>(), "after"_a = 0,
           "Those with ids above `after`, ascending, as they are at one moment. Damaged ones are "
           "left out; `warnings` has a message for each.")
      .def(
          "remove",
          [](OpenMap& map, const std::vector<int64_t>& ids) {
            return map.with([&](MapStore& store) { return store.remove(ids); });
          },
          nb::call_guard<Unlocked>(), "ids"_a,
          "Removes places for good, in one step, damaged ones, too. Their ids are not given again. "
          "Returns how many there were to remove.\n"
          "Raises UsageError for an id that no place has had, and in a map opened for reading.")
      .def(
          "removed",
          [](OpenMap& map, int64_t after) {
            return map.with([&](const MapStore& store) { return store.removed(after); });
          },
          nb::call_guard<Unlocked>(), "after"_a = 0,
          "The ids of the places that were removed, in the order of their removal, but for the "
          "first `after`.")
      .def_prop_ro(
          "warnings", [](const OpenMap& map) { return map.messages.all(); },
          "Of places that could not be read.")
      .def("close", &OpenMap::close, nb::call_guard<Unlocked>())
      .def("__enter__", [](nb::handle self) { return nb::borrow(self); })
      .def("__exit__", [](OpenMap& map, const nb::args&) { without_lock([&] { map.close(); }); });
}

}  // namespace

void bind_map_store(nb::module_& module) {
  bind_place(module);
  bind_open_map(module);
  module.def(
      "maker_of", &maker_of, nb::call_guard<Unlocked>(), "map"_a,
      "What made the features of a map, FeatureExtractor.key; '' without a map that can be read.");
  module.def("check_map", &check_map, nb::call_guard<Unlocked>(), "file"_a,
             "What is wrong with a map, a message each: none when it is sound.");
  module.def(
      "merge_maps",
      [](const std::vector<fs::path>& maps, const fs::path& file) {
        std::vector<std::string> damaged;
        const int64_t places =
            merge_maps(maps, file, [&](const std::string& message) { damaged.push_back(message); });
        return std::pair(places, damaged);
      },
      nb::call_guard<Unlocked>(), "maps"_a, "file"_a,
      "Puts the places of all maps into a new one. Returns how many there are, and a message for "
      "each that could not be read and was left out.");
}

}  // namespace revisit::python
