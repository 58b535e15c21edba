#include "kernel.hpp"

namespace omnimirror {

const ReflectionKernel plain_reflections = {find_some, meet_some};

}  // namespace omnimirror
