#include "run.h"

#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include "module.h"
#include "revisit/profiling/profile.h"
#include "unlocked.h"

namespace revisit::python {
namespace {

using namespace nb::literals;
using Arrays = nb::typed<nb::dict, nb::str, nb::object>;

Run& run_of(nb::handle self) {
  return nb::cast<Run&>(self);
}

template <class T>
nb::ndarray<nb::numpy, T> array_of_view(const engine::View<T>& view, nb::handle self) {
  return view_of(view.data, view.shape.axes(), self);
}

ReadOnlyFloats output_of(nb::handle self, const std::string& name) {
  return run_of(self).alone(
      [&](const engine::Run& run) { return array_of_view(run.output(name), self); });
}

/// Copies an array with any strides. Throws for another type or shape.
void set_input(engine::Run& run, nb::handle self, const std::string& name, nb::handle values) {
  const auto view = run.input(name);
  const auto array = float_array(values, "input '" + name + "'");
  if (shape_of(array) != view.shape.axes())
    throw value_error(str("input '", name, "': expected an array of shape ", view.shape.text(),
                          ", found ", shape_text(shape_of(array))));
  const nb::object to = nb::cast(array_of_view(view, self)), copy = to.attr("__setitem__");
  call(copy, nb::ellipsis(), values);
}

void bind_profile(nb::module_& module) {
  using profiling::Profile;
  using profiling::Timing;
  nb::class_<Timing>(module, "Timing", "Statistics of repeated timings [ms].")
      .def_ro("min", &Timing::min, "Shortest time [ms].")
      .def_ro("median", &Timing::median, "Median time [ms].")
      .def_ro("p95", &Timing::p95, "95th percentile [ms].")
      .def("__repr__", [](const Timing& timing) {
        return str("Timing(min=", timing.min, ", median=", timing.median, ", p95=", timing.p95,
                   ")");
      });
  nb::class_<Profile>(module, "Profile", "Times of each layer and of full passes.")
      .def_ro("layers", &Profile::layers, nb::rv_policy::copy, "Times in the order of Plan.layers.")
      .def_ro("layer_sum", &Profile::layer_sum, nb::rv_policy::copy,
              "Sum over the layers of each pass.")
      .def_ro("total", &Profile::total, nb::rv_policy::copy, "Times of uninstrumented passes.")
      .def_ro("passes", &Profile::passes, "Number of timed passes of each kind.");
  module.def(
      "profile",
      [](Run& run, int warmup, int repeat) {
        return run.alone([&](engine::Run& alone) {
          Listener listener;
          return listener.run([&] {
            return profiling::profile(alone, warmup, repeat, [&] { return listener.stop(); });
          });
        });
      },
      "run"_a, nb::kw_only(), "warmup"_a = profiling::kWarmup, "repeat"_a = profiling::kRepeat,
      "Times forward passes of a run with its current inputs, after `warmup` untimed ones. Raises "
      "UsageError if another thread uses the run, Interrupted on Ctrl-C.");
}

}  // namespace

Run::Run(const engine::Plan& plan) : run_(without_lock([&] { return engine::Run(plan); })) {}

void bind_run(nb::module_& module) {
  nb::class_<Run>(module, "Run",
                  "Execution context with the memory of a plan. Create one per thread: concurrent "
                  "use by a second thread raises UsageError.")
      .def(nb::init<const engine::Plan&>(), "plan"_a,
           "Allocates Plan.arena_bytes. Inputs are NaN until set. Raises UsageError for a net "
           "without weights, MemoryError.")
      .def_prop_ro(
          "plan", [](const Run& run) { return run.plan(); }, "Its plan.")
      .def(
          "input",
          [](nb::handle self, const std::string& name) {
            return array_of_view(run_of(self).input(name), self);
          },
          "name"_a,
          "Writable view of an input. Must not be written during a pass. Values persist across "
          "forward passes. Raises UsageError for an unknown name.")
      .def(
          "set_input",
          [](nb::handle self, const std::string& name, GivenFloats values) {
            run_of(self).alone([&](engine::Run& run) { set_input(run, self, name, values); });
          },
          "name"_a, "values"_a,
          "Copies a float32 array of the input's exact shape, with any strides. Raises TypeError "
          "for another type, ValueError for another shape.")
      .def(
          "forward",
          [](nb::handle self, const nb::typed<nb::dict, nb::str, FloatArray>& inputs) {
            run_of(self).alone([&](engine::Run& run) {
              for (const auto& [name, values] : inputs)
                set_input(run, self, name_from(name, "inputs"), values);
              without_lock([&] { run.forward(); });
            });
          },
          "inputs"_a = nb::dict(),
          "Runs one pass after set_input() of `inputs`. Other inputs keep their values. Raises as "
          "set_input(), and UsageError while another thread uses the run.")
      .def("output", &output_of, "name"_a,
           "Read-only view of an output, which the next pass overwrites. If it is a view of an "
           "input (Reshape, Slice), setting that input overwrites it. If the number of rows "
           "depends on the data, the shape is that of the last pass. Raises UsageError for an "
           "unknown name.")
      .def(
          "layer_output",
          [](nb::handle self, const std::string& name) {
            return run_of(self).alone([&](const engine::Run& run) {
              return array_of_view(run.layer_output(name), self);
            });
          },
          "name"_a,
          "Output of a layer, before later in-place layers; `name` as from port_name(). Raises "
          "UsageError unless planned with keep_all, or with the name in keep.")
      .def(
          "outputs",
          [](nb::handle self) {
            nb::dict outputs;
            for (const engine::Port& port : run_of(self).plan().outputs())
              outputs[text_of(port.name)] = output_of(self, port.name);
            return nb::borrow<nb::typed<nb::dict, nb::str, ReadOnlyFloats>>(outputs);
          },
          "Read-only views of all outputs by name.");
  bind_profile(module);
}

}  // namespace revisit::python
