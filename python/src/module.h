#pragma once

#include <nanobind/nanobind.h>

namespace revisit::python {

namespace nb = nanobind;

void translate_errors();
void bind_proto(nb::module_& module);
void bind_engine(nb::module_& module);
#ifdef REVISIT_HAVE_PIPELINE
void bind_recognition(nb::module_& module);
void bind_features(nb::module_& module);
void bind_pca(nb::module_& module);
void bind_datasets(nb::module_& module);
void bind_evaluation(nb::module_& module);
void bind_maps(nb::module_& module);
void bind_registration(nb::module_& module);
void bind_simulation(nb::module_& module);
#endif

}  // namespace revisit::python
