#include "kernel.hpp"

namespace omnimirror {

const ReflectionKernel avx2_reflections = {reflection_batch, intersection_batch};

}  // namespace omnimirror
