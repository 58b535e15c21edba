#include "reflection.hpp"

#include "pieces.hpp"
#include "sampling/sample.hpp"

namespace omnimirror {
namespace {

constexpr int RAYS_A_PIECE = 4096;

// The samplers choose the instructions; those without a kernel here take the plain one.
const ReflectionKernel& reflection_kernel() {
#if defined(OMNIMIRROR_AVX2)
    if (kernels().level >= Level::AVX2) return avx2_reflections;
#endif
    return plain_reflections;
}

}  // namespace

void find_reflections(const SeenJob& job) { in_pieces(job, RAYS_A_PIECE, reflection_kernel().find); }

void meet_mirror(const MetJob& job) { in_pieces(job, RAYS_A_PIECE, reflection_kernel().meet); }

}  // namespace omnimirror
