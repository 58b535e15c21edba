// What Python sees of exposure.hpp and surfaces.hpp.
#pragma once

#include <nanobind/nanobind.h>

namespace omnimirror {

void add_exposure(nanobind::module_& m);
void add_surfaces(nanobind::module_& m);

}  // namespace omnimirror
