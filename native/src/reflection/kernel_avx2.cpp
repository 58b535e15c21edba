#include "kernel.hpp"

namespace omnimirror {

const ReflectionKernel avx2_reflections = {find_some, meet_some};

}  // namespace omnimirror
