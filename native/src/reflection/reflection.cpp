#include "reflection.hpp"

#include "pieces.hpp"
#include "sampling/sample.hpp"

namespace omnimirror {
namespace {

constexpr int RAYS_A_PIECE = 4096;

// Uses the instruction set selected for the samplers, or the plain kernel if there is none for it.
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
