// What Python sees of designs.hpp.
#pragma once

#include <nanobind/nanobind.h>

namespace omnimirror {

void add_designs(nanobind::module_& m);

}  // namespace omnimirror
