// What Python sees of deblur.hpp.
#pragma once

#include <nanobind/nanobind.h>

namespace omnimirror {

void add_deblurring(nanobind::module_& m);

}  // namespace omnimirror
