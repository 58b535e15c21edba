#include "kernel.hpp"

namespace omnimirror {

const ReflectionKernel plain_reflections = {reflection_batch, intersection_batch};

}  // namespace omnimirror
