// What Python sees of exposure.hpp.
#pragma once

#include <nanobind/nanobind.h>

namespace omnimirror {

void add_exposure(nanobind::module_& m);

}  // namespace omnimirror
