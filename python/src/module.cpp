#include "module.h"

NB_MODULE(_core, core) {
  using namespace revisit::python;
  core.doc() = "What revisit's C++ libraries offer to Python: a module a library.";
  core.attr("__version__") = REVISIT_VERSION;
  translate_errors();

  const auto library = [&](const char* name, const char* doc, void (*bind)(nb::module_&)) {
    nb::module_ module = core.def_submodule(name, doc);
    bind(module);
  };
  library("proto", "Files of Caffe's networks.", bind_proto);
  library("engine", "Caffe networks on the CPU.", bind_engine);
}
