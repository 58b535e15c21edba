#include "reflection.hpp"

#include "batches.hpp"
#include "sampling/sample.hpp"

namespace omnimirror {
namespace {

constexpr int RAYS_PER_TASK = 4096;

// Uses the instruction set selected for the samplers, or the plain kernel if there is none for it.
const ReflectionKernel& reflection_kernel() {
#if defined(OMNIMIRROR_AVX2)
    if (kernels().level >= Level::AVX2) return avx2_reflections;
#endif
    return plain_reflections;
}

}  // namespace

void find_reflections(const ReflectionJob& job) { in_batches(job, RAYS_PER_TASK, reflection_kernel().find); }

void intersect_mirror(const IntersectionJob& job) { in_batches(job, RAYS_PER_TASK, reflection_kernel().intersect); }

}  // namespace omnimirror
