#include "revisit/simulation/simulation.h"

#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>

#include <filesystem>

#include "module.h"
#include "unlocked.h"

namespace revisit::python {
namespace fs = std::filesystem;
using namespace nb::literals;

void bind_simulation(nb::module_& module) {
  nb::class_<SimulationSummary>(module, "SimulationSummary", "Statistics of a simulation.")
      .def_ro("scans", &SimulationSummary::scans, "Requested scans, all complete.")
      .def_ro("kept", &SimulationSummary::kept, "Scans already complete from an earlier call.")
      .def_ro("mean_points", &SimulationSummary::mean_points, "Mean points per scan.")
      .def_ro("path_meters", &SimulationSummary::path_meters)
      .def_ro("build_seconds", &SimulationSummary::build_seconds, "Time to build the world.")
      .def_ro("scan_seconds", &SimulationSummary::scan_seconds)
      .def_ro("triangles", &SimulationSummary::triangles);
  module.def(
      "simulate",
      [](const fs::path& output, const std::string& sequence, const std::string& surroundings,
         double traffic, const std::string& route, double length,
         const std::optional<fs::path>& poses, int first_frame, std::optional<int> last_frame,
         int every, const std::string& sensor, bool rolling_shutter, double range_noise,
         double dropout, uint64_t seed, int threads, bool overwrite, const nb::object& progress) {
        SimulationConfig config;
        config.output = output;
        config.sequence = sequence;
        config.surroundings = surroundings;
        config.traffic = traffic;
        config.route = route;
        config.length = length;
        config.poses = poses;
        config.first_frame = first_frame;
        config.last_frame = last_frame;
        config.every = every;
        config.sensor = sensor;
        config.rolling_shutter = rolling_shutter;
        config.range_noise = range_noise;
        config.dropout = dropout;
        config.seed = seed;
        config.threads = threads;
        config.overwrite = overwrite;
        Listener listener;
        return listener.run([&] {
          return simulate(
              config, [&](int64_t done, int64_t total) { listener.tell(progress, done, total); },
              [&] { return listener.stop(); });
        });
      },
      "output"_a, nb::kw_only(), "sequence"_a = SimulationConfig().sequence,
      "surroundings"_a = SimulationConfig().surroundings, "traffic"_a = SimulationConfig().traffic,
      "route"_a = SimulationConfig().route, "length"_a = SimulationConfig().length,
      "poses"_a = nb::none(), "first_frame"_a = 0, "last_frame"_a = nb::none(), "every"_a = 1,
      "sensor"_a = SimulationConfig().sensor, "rolling_shutter"_a = false,
      "range_noise"_a = SimulationConfig().range_noise, "dropout"_a = SimulationConfig().dropout,
      "seed"_a = SimulationConfig().seed, "threads"_a = 0, "overwrite"_a = false,
      "progress"_a = nb::none(),
      "Simulates a drive through a synthetic world and writes a data set in KITTI's layout, for "
      "open_dataset().\n\n"
      "surroundings: 'town', 'suburb', 'village', 'country', 'motorway', 'car-park', 'old-town' or "
      "'rows'.\n"
      "route: direction of revisits: 'loop' (same), 'opposite' or 'both'.\n"
      "length: of the route [m], 300 to 30000.\n"
      "poses: a KITTI poses file that replaces the route.\n"
      "first_frame, last_frame, every: frames to scan; the frame interval is 0.1 s.\n"
      "sensor: 'hdl64', 'vlp16', 'ouster-os1-64', 'front120' or 'livox-avia'.\n"
      "rolling_shutter: the vehicle moves during a scan; read_timed_scan() reads the times.\n"
      "progress: called with (done, total) scans. An exception from it, or Ctrl-C, stops the "
      "simulation. Complete scans are kept; the same call resumes.");
}

}  // namespace revisit::python
