#include "run.h"

#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include "listener.h"
#include "revisit/profiling/profile.h"
#include "strings.h"

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

/// numpy copies, whatever the strides; types and shapes have to be right.
void set_input(engine::Run& run, nb::handle self, const std::string& name, nb::handle values) {
  const auto view = run.input(name);
  const auto array = float_array(values, "input '" + name + "'");
  if (shape_of(array) != view.shape.axes())
    throw value_error(str("input '", name, "': expected an array of shape ",
                          engine::text_of(view.shape.axes()), ", found ",
                          engine::text_of(shape_of(array))));
  const nb::object to = nb::cast(array_of_view(view, self)), copy = to.attr("__setitem__");
  call(copy, nb::ellipsis(), values);
}

void bind_profile(nb::module_& module) {
  using profiling::Profile;
  using profiling::Timing;
  nb::class_<Timing>(module, "Timing", "Of repeated timings [ms].")
      .def_ro("min", &Timing::min)
      .def_ro("median", &Timing::median)
      .def_ro("p95", &Timing::p95)
      .def("__repr__", [](const Timing& timing) {
        return str("Timing(min=", timing.min, ", median=", timing.median, ", p95=", timing.p95,
                   ")");
      });
  nb::class_<Profile>(module, "Profile", "What each layer and the whole take.")
      .def_ro("layers", &Profile::layers, nb::rv_policy::copy, "As Plan.layers.")
      .def_ro("layer_sum", &Profile::layer_sum, nb::rv_policy::copy,
              "The sum of the layers, pass by pass.")
      .def_ro("total", &Profile::total, nb::rv_policy::copy, "Of uninstrumented passes.")
      .def_ro("passes", &Profile::passes);
  module.def(
      "profile",
      [](Run& run, int warmup, int repeat) {
        return run.alone([&](engine::Run& alone) {
          Listener listener;
          return listener.run([&] {
            return profiling::profile(alone, {.warmup = warmup, .repeat = repeat, .stop = [&] {
                                                return listener.stop();
                                              }});
          });
        });
      },
      "run"_a, nb::kw_only(), "warmup"_a = profiling::ProfileOptions().warmup,
      "repeat"_a = profiling::ProfileOptions().repeat,
      "Times forward passes of a run as it stands; its inputs are not changed.");
}

}  // namespace

Run::Run(const engine::Plan& plan) : run_(without_lock([&] { return engine::Run(plan); })) {}

void bind_run(nb::module_& module) {
  nb::class_<Run>(module, "Run",
                  "One execution context: the memory of a plan. One per thread: a second thread "
                  "that uses it at the same time gets a UsageError.")
      .def(nb::init<const engine::Plan&>(), "plan"_a,
           "Allocates Plan.arena_bytes. Inputs are NaN until they are filled. Raises UsageError "
           "for a net without weights, MemoryError.")
      .def_prop_ro("plan", [](const Run& run) { return run.plan(); })
      .def(
          "input",
          [](nb::handle self, const std::string& name) {
            return array_of_view(run_of(self).input(name), self);
          },
          "name"_a,
          "The memory of an input, to be written to, but not during a pass; it keeps its values "
          "over forward passes.")
      .def(
          "set_input",
          [](nb::handle self, const std::string& name, GivenFloats values) {
            run_of(self).alone([&](engine::Run& run) { set_input(run, self, name, values); });
          },
          "name"_a, "values"_a,
          "Copies an array of float32 of exactly the input's shape, with any strides. Raises "
          "TypeError for another type, ValueError for another shape.")
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
          "One pass. `inputs` are set before, as set_input() does; the others stay as they are.")
      .def("output", &output_of, "name"_a,
           "An output of the net, read-only: the run's own memory, which the next pass overwrites; "
           "where it is an input in another shape (Reshape, Slice), a new input does so already. "
           "Where the number of rows depends on the data the shape is that of the last pass.")
      .def(
          "layer_output",
          [](nb::handle self, const std::string& name) {
            return run_of(self).alone([&](const engine::Run& run) {
              return array_of_view(run.layer_output(name), self);
            });
          },
          "name"_a,
          "What a layer put out, before any later layer worked on it in place; port_name() names "
          "it. UsageError unless planned with keep_all, or with the name in keep.")
      .def(
          "outputs",
          [](nb::handle self) {
            nb::dict outputs;
            for (const engine::Port& port : run_of(self).plan().outputs())
              outputs[text_of(port.name)] = output_of(self, port.name);
            return nb::borrow<nb::typed<nb::dict, nb::str, ReadOnlyFloats>>(outputs);
          },
          "All outputs of the net by name.");
  bind_profile(module);
}

}  // namespace revisit::python
